"""Settings by which GDAL opens no address, whatever the files that it reads refer to."""

from typing import Final

OFFLINE: Final = {
    # libcurl has no such proxy, and connects to nothing.
    "GDAL_HTTP_PROXY": "offline://",
    "GDAL_HTTPS_PROXY": "offline://",
    "CPL_VSIL_CURL_ALLOWED_FILENAME": "none",
}
"""Options for `rasterio.Env` and `pyogrio.set_gdal_config_options`, and variables for child processes."""

ONLINE_DRIVERS = "HTTP WMS WMTS WCS EEDA EEDAI PLMOSAIC STACIT STACTA DAAS ESRIC GTI MBTiles MVT OSM PDF"
"""Drivers that open addresses; ``GDAL_SKIP`` leaves them out if it is set before GDAL is loaded."""
