"""Rows of forms: scales, gestures, number, clock, choice and text fields."""

import pytest
from PyQt6.QtCore import Qt
from PyQt6.QtTest import QTest

from sketchterrain.document.sketch import TABLES
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui.panels import controls as numbers
from sketchterrain.ui.panels.controls import SLIDER_STEPS, ClockBox, Gesture, Scale
from sketchterrain.ui.panels.form import ChoiceRow, NumberRow, TextRow

from .events import wheel

HEIGHT = LAYERS["plateau"].parameters["height"]
FLOW = LAYERS["river"].parameters["flow"]
PARAMETERS = {
    **{f"sketch.{name}": each for name, each in SKETCH.items()},
    **{f"{table}.{name}": each for table, all_ in TABLES.items() for name, each in all_.items()},
    **{f"{layer.name}.{name}": each for layer in LAYERS.values() for name, each in layer.parameters.items()},
}
NUMBERS = {name: each for name, each in PARAMETERS.items() if each.kind is not str}
SCALES = [Scale(0.0, 1.0), Scale(1.0, 9000.0, "ratio"), Scale(0.0, 2000.0, "cube"), Scale(-90.0, 90.0)]


def test_scales_are_monotonic_and_inverted_by_their_fraction():
    for scale in [*SCALES, Scale(1, 500, "ratio", whole=True)]:
        values = [scale.value(n / 500) for n in range(501)]
        assert values[0] == scale.low, scale
        assert values[-1] == scale.high, scale
        assert values == sorted(values), scale
        assert all(float(value).is_integer() for value in values) or not scale.whole, scale

    for scale in SCALES:
        for n in range(11):
            value = scale.value(n / 10)
            assert scale.fraction(value) == pytest.approx(n / 10, abs=0.004), scale  # values are rounded
            assert scale.value(scale.fraction(value)) == pytest.approx(value, rel=1e-9, abs=1e-9), scale


def test_slider_ranges_and_values_are_allowed_ones():
    for name, parameter in NUMBERS.items():
        low, high = numbers.slider_range(parameter)
        assert parameter.low <= low < high <= parameter.high, name
        scale = Scale.suited(parameter, low, high)
        for n in range(21):
            parameter.check(int(scale.value(n / 20)) if parameter.kind is int else scale.value(n / 20))


def test_a_drag_and_quick_key_presses_share_one_merge_key(monkeypatch):
    now = 100.0
    monkeypatch.setattr(numbers.time, "monotonic", lambda: now)
    gesture = Gesture()
    first = gesture.key
    now += 0.5
    assert gesture.key is first
    now += 5.0
    later = gesture.key
    assert later is not first
    gesture.begin()
    dragged = gesture.key
    now += 60.0
    assert gesture.key is dragged is not later
    gesture.end()
    assert gesture.key is not dragged


@pytest.fixture
def reported():
    return []


@pytest.fixture
def listening(show_widget, reported):
    """Show a row and record its signals."""

    def listen(row):
        row.edited.connect(lambda value, key: reported.append((value, key)))
        row.show_value(row.parameter.default)
        return show_widget(row, 280, 60)

    return listen


def test_a_slider_keeps_its_position_when_its_value_is_rounded(listening, reported):
    row = listening(NumberRow(HEIGHT))
    row.edited.connect(lambda value, _: row.show_value(value))
    for place in (501, 502, 503, 650, 1000, 0):
        row.slider.setValue(place)
        assert row.slider.value() == place
        assert row.box.value() == pytest.approx(reported[-1][0])
    row.slider.setFocus()
    before = row.slider.value()
    for _ in range(30):  # a key moves the slider even if the rounded value stays
        QTest.keyClick(row.slider, Qt.Key.Key_Right)
    assert row.slider.value() == before + 30 * row.slider.singleStep()
    assert row.slider.maximum() == SLIDER_STEPS


def test_a_number_is_reported_when_typed_and_not_rounded_by_display(listening, reported):
    row = listening(NumberRow(TABLES["climate"]["snow_line"]))
    row.show_value(-250.0)
    assert row.box.value() == -250.0
    assert row.slider.value() == 0
    row = listening(NumberRow(SKETCH["extent"]))
    row.show_value(1e6)
    assert row.box.value() == 1e6
    assert not reported

    row = listening(NumberRow(HEIGHT, decimals=1))
    row.show_value(123.456789)
    row.box.setFocus()
    row.slider.setFocus()
    assert row.number == 123.456789
    assert not reported

    row = listening(NumberRow(HEIGHT))
    row.box.selectAll()
    QTest.keyClicks(row.box, "1234,5")
    assert not reported
    QTest.keyClick(row.box, Qt.Key.Key_Return)
    assert [value for value, _ in reported] == [1234.5]


def test_a_sentinel_is_a_check_box(listening, reported):
    row = listening(NumberRow(FLOW))
    assert row.check.isChecked()
    assert not row.box.isEnabled()
    assert not row.slider.isEnabled()
    row.check.click()
    assert reported[-1][0] == 180.0
    row.show_value(90.0)
    assert row.box.isEnabled()
    assert row.box.value() == 90.0
    row.check.click()
    assert reported[-1][0] == -1.0
    row.show_value(-1.0)
    row.check.click()
    assert reported[-1][0] == 90.0, "the previous number"


def test_hours_are_clock_times(listening, reported, qtbot):
    accepted = (("18:30", 18.5, "18:30"), ("6.25", 6.25, "6:15"), ("24", 24.0, "24:00"))
    for typed, hours, text in (*accepted, ("7:", None, ""), ("25:00", None, "")):
        row = listening(NumberRow(TABLES["weather"]["hour"]))
        row.show_value(12.0)
        assert row.box.text() == "12:00", typed
        row.box.selectAll()
        QTest.keyClicks(row.box, typed)
        QTest.keyClick(row.box, Qt.Key.Key_Return)
        if hours is None:
            assert not reported or reported[-1][0] <= 24.0, typed
        else:
            assert reported[-1][0] == hours, typed
            assert row.box.text() == text, typed

    for minute in range(0, 60, 7):
        box = ClockBox(0.0, 24.0)
        qtbot.addWidget(box)
        text = f"18:{minute:02}"
        box.setValue(box.valueFromText(text))
        assert box.text() == text, minute


def test_the_wheel_changes_only_a_focused_control(listening, reported):
    for widget in ("box", "slider"):
        row = listening(NumberRow(HEIGHT))
        control = getattr(row, widget)
        reported.clear()
        row.setFocus()
        wheel(control, 5, 5, 1)
        assert not reported, widget
        row.activateWindow()
        control.setFocus()
        if control.hasFocus():
            wheel(control, 5, 5, 1)
            assert reported, widget


def test_tab_order_follows_reading_order(listening):
    for parameter in [HEIGHT, FLOW]:
        row = listening(NumberRow(parameter))
        row.show_value(100.0)
        controls = [each for each in (row.box, row.slider, row.check, row.reset) if each is not None]
        chain = [row]
        for _ in range(40):
            chain.append(chain[-1].nextInFocusChain())
        assert list(dict.fromkeys(each for each in chain if each in controls)) == controls, parameter


def test_choices_and_texts_are_reported_once(listening, reported):
    parameter = LAYERS["material"].parameters["material"]
    row = listening(ChoiceRow(parameter))
    assert row.box.currentData() == "rock"
    QTest.keyClick(row.box, Qt.Key.Key_Down)
    assert reported[-1][0] == parameter.choices[parameter.choices.index("rock") + 1]

    reported.clear()
    row = listening(TextRow(SKETCH["name"]))
    row.field.selectAll()
    QTest.keyClicks(row.field, "Alps")
    assert not reported
    QTest.keyClick(row.field, Qt.Key.Key_Return)
    assert reported[-1][0] == "Alps"
    row.show_value("Alps")
    QTest.keyClick(row.field, Qt.Key.Key_Return)
    assert len(reported) == 1
