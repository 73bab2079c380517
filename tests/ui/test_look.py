"""Themes, icons and contrast."""

import numpy as np
import pytest
from PyQt6.QtCore import QSize
from PyQt6.QtGui import QColor, QIcon, QImage, QPalette

from sketchterrain.ui.actions import COMMANDS
from sketchterrain.ui.look.theme import DARK, ICONS, LIGHT, active_theme, apply_theme, icon, theme


@pytest.fixture
def light_after(qapp):
    yield
    apply_theme(qapp, "system")


def coverage(image: QImage) -> np.ndarray:
    """Alpha of a picture, 0 … 1."""
    plain = image.convertToFormat(QImage.Format.Format_RGBA8888)
    pixels = np.frombuffer(plain.constBits().asstring(plain.sizeInBytes()), np.uint8)
    return pixels.reshape(plain.height(), plain.bytesPerLine() // 4, 4)[:, : plain.width(), 3] / 255.0


def test_all_named_icons_exist_and_fit_their_square(qapp):
    named = {command.icon for command in COMMANDS.values()} - {""}
    assert named <= {file.stem for file in ICONS.glob("*.svg")}
    for file in ICONS.glob("*.svg"):
        cover = coverage(icon(file.stem).pixmap(QSize(80, 80), 1.0).toImage())
        rows, columns = np.nonzero(cover > 0.05)
        assert max(np.ptp(rows), np.ptp(columns)) >= 40, file
        assert min(rows.min(), columns.min()) >= 1, file
        assert max(rows.max(), columns.max()) <= 78, file
    with pytest.raises(FileNotFoundError):
        icon("nonsense")


def test_icons_render_at_device_pixels_in_the_palette_colour(qapp, light_after):
    for size, dpr in [(16, 1.0), (20, 1.25), (20, 2.0), (32, 1.5)]:
        picture = icon("brush").pixmap(QSize(size, size), dpr)
        assert (picture.width(), picture.height()) == (round(size * dpr), round(size * dpr)), (size, dpr)
        cover = coverage(picture.toImage())
        assert cover.max() > 0.95, (size, dpr)
        assert 0.05 < cover.mean() < 0.6, (size, dpr)

    add = icon("add")
    for choice in ("light", "dark"):
        apply_theme(qapp, choice)
        image = add.pixmap(QSize(20, 20)).toImage()
        assert image.pixelColor(10, 10).rgb() == theme().text.rgb()
        off = add.pixmap(QSize(20, 20), QIcon.Mode.Disabled).toImage().pixelColor(10, 10)
        assert off.rgb() == theme().disabled.rgb()


def luminance(colour: QColor) -> float:
    parts = np.array([colour.redF(), colour.greenF(), colour.blueF()])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: QColor, other: QColor) -> float:
    """Return the contrast ratio of WCAG 2: 1 … 21."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def test_text_contrast_meets_wcag():
    for each in [LIGHT, DARK]:
        for behind in (each.window, each.base, each.raised):
            floors = {"text": 7.0, "faint": 4.5, "warning": 4.5, "error": 4.5, "accent": 3.0}
            for name, floor in floors.items():
                assert contrast(getattr(each, name), behind) >= floor, (each, name)
        assert contrast(each.on_accent, each.accent) >= 4.5, each


def test_themes_set_the_palette_and_unknown_themes_raise(qapp, qtbot, light_after):
    for choice, expected in (("light", LIGHT), ("dark", DARK)):
        with qtbot.waitSignal(active_theme.changed):
            apply_theme(qapp, choice)
        assert theme() is expected
        assert qapp.palette().color(QPalette.ColorRole.Window) == expected.window

    with pytest.raises(ValueError, match="expected a theme, one of system, light, dark, got 'pink'"):
        apply_theme(qapp, "pink")
