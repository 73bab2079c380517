"""What the real QGIS finds in a project: run by its own Python, prints JSON.

Arguments: the project, a picture to draw, and a text file of points x y.
"""

import json
import sys
from pathlib import Path

from qgis._3d import Qgs3D, Qgs3DMapSettings
from qgis.core import (
    QgsApplication,
    QgsExpressionContext,
    QgsExpressionContextUtils,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsPointXY,
    QgsProject,
    QgsReadWriteContext,
)
from qgis.PyQt.QtCore import QSize
from qgis.PyQt.QtXml import QDomDocument

path, picture, points = sys.argv[1:]
application = QgsApplication([], True)
application.initQgis()
Qgs3D.initialize()
messages = []
QgsApplication.messageLog().messageReceived.connect(lambda text, tag, level: messages.append(text))
project = QgsProject.instance()
views = []
project.readProject.connect(lambda document: views.append(document.toString()))
read = project.read(path)
layers = [node.layer() for node in project.layerTreeRoot().findLayers()]
shown = [node.layer() for node in project.layerTreeRoot().findLayers() if node.isVisible()]
extent, crs = project.viewSettings().defaultViewExtent(), project.crs()

settings = QgsMapSettings()
settings.setLayers(shown)
settings.setDestinationCrs(crs)
settings.setExtent(extent)
settings.setOutputSize(QSize(800, 800))
settings.setTransformContext(project.transformContext())
context = QgsExpressionContext()
context.appendScope(QgsExpressionContextUtils.projectScope(project))
context.appendScope(QgsExpressionContextUtils.mapSettingsScope(settings))
settings.setExpressionContext(context)
job = QgsMapRendererParallelJob(settings)
job.start()
job.waitForFinished()
job.renderedImage().save(picture)

document = QDomDocument()
document.setContent(views[0])
view = document.elementsByTagName("qgis3d").at(0).toElement()
scene = Qgs3DMapSettings()
scene.readXml(view, QgsReadWriteContext())
scene.resolveReferences(project)

relief = next(layer for layer in layers if layer.name() == "Relief").dataProvider()
places = [tuple(map(float, row.split())) for row in Path(points).read_text(encoding="utf-8").splitlines()]
sys.stdout.write(
    json.dumps(
        {
            "read": read,
            "error": project.error(),
            "messages": messages,
            "drawing": [error.message for error in job.errors()],
            "layers": {
                layer.name(): {
                    "valid": layer.isValid(),
                    "error": layer.error().message(),
                    "crs": layer.crs() == crs,
                    "source": layer.source(),
                    "features": layer.featureCount() if hasattr(layer, "featureCount") else None,
                    "solid": hasattr(layer, "renderer3D") and layer.renderer3D() is not None,
                }
                for layer in layers
            },
            "crs": [crs.isValid(), crs.authid(), crs.mapUnits()],
            "extent": [extent.xMinimum(), extent.yMinimum(), extent.xMaximum(), extent.yMaximum()],
            "heights": [relief.sample(QgsPointXY(x, y), 1)[0] for x, y in places],
            "view": {
                "scale": scene.terrainVerticalScale(),
                "crs": scene.crs() == crs,
                "layers": [layer.name() for layer in scene.layers()],
                "lights": len(scene.directionalLights()),
                "theme": project.mapThemeCollection().hasMapTheme(scene.terrainMapTheme()),
                "origin": [scene.origin().x(), scene.origin().y()],
            },
        }
    )
)
