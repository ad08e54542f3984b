import pytest

from ciir.errors import InvalidOption
from ciir.renderer.displays.devices import DEVICES, find_aspect, find_layout, match_views, resolve_quilt
from ciir.renderer.displays.quilt import QuiltLayout, QuiltName

PORTRAIT, GO = DEVICES["portrait"], DEVICES["go"]
GO_NAME = QuiltName(11, 6, 0.5625)


def test_without_anything_it_is_the_default_devices_with_a_note():
    found = resolve_quilt()
    assert (found.layout, found.tile, found.keeps_aspect) == (PORTRAIT.layout, (560, 420), True)
    assert found.notes[0].startswith(
        "quilt: made for the device portrait; the option device selects another: portrait, go,"
    )


@pytest.mark.parametrize(
    ("count", "aspect", "name"),
    [
        (66, 9 / 16, "go"),
        (66, 2.0, "go"),  # all devices of 66 views have the same layout
        (48, 0.75, "portrait"),
        (48, 1.6, "16-landscape"),
        (45, 1.0, "8.9"),
        (5, 1.33, "portrait"),  # no device has 5 views
    ],
)
def test_the_default_is_a_device_with_as_many_views_as_the_light_field_and_the_nearest_aspect(count, aspect, name):
    found = match_views(resolve_quilt(), count, aspect)
    device = DEVICES[name]
    assert (found.layout, found.tile, found.cone) == (device.layout, device.tile, device.cone)
    assert found.keeps_aspect
    reason = "" if count == 5 else f", which shows {count} views, as many as a row of the light field has"
    assert found.notes[0].startswith(f"quilt: made for the device {name}{reason}; the option device selects another:")


@pytest.mark.parametrize(
    "given", [{"device": "portrait"}, {"named": QuiltName(8, 6)}, {"grid": (8, 6)}, {"aspect": 0.75}]
)
def test_what_is_given_wins_over_the_number_of_views(given):
    quilt = resolve_quilt(**given)
    assert match_views(quilt, 66, 9 / 16) == quilt


@pytest.mark.parametrize("device", DEVICES.values(), ids=DEVICES)
def test_a_quilt_of_a_device_is_known_by_its_size(device):
    """Its pixels need not be square. Quilts of a size that two devices have would be ambiguous."""
    layout = device.layout
    assert find_layout((device.height, device.width)) == layout
    assert find_aspect((layout.rows, layout.cols), device.tile) == layout.aspect
    assert find_aspect((layout.cols + 1, layout.rows), device.tile) is None
    assert find_layout((device.height + 1, device.width)) is None


@pytest.mark.parametrize(
    "given", [{"device": "go"}, {"device": "Go"}, {"named": GO_NAME}, {"device": "go", "named": GO_NAME}]
)
def test_a_device_or_a_name_gives_layout_size_and_cone(given):
    found = resolve_quilt(**given)
    assert (found.layout, found.tile, found.cone) == (GO.layout, (682, 372), 40.0)
    assert (found.keeps_aspect, found.notes) == (False, ())


def test_columns_rows_and_aspect_can_be_overridden():
    found = resolve_quilt(device="16-landscape", grid=(5, 9), aspect=1.6)
    assert (found.layout, found.cone) == (QuiltLayout(5, 9, 1.6), 50.0)
    height, width = found.tile
    assert width / height == pytest.approx(1.6, abs=1 / height)
    assert 5 * width <= 7680
    assert 9 * height <= 4320


def test_a_light_field_keeps_its_aspect_where_only_columns_and_rows_are_given():
    assert resolve_quilt(grid=(5, 9)).keeps_aspect
    assert not resolve_quilt(aspect=1.0).keeps_aspect


@pytest.mark.parametrize(("cols", "rows", "aspect", "tile"), [(11, 6, 9 / 16, GO.tile), (5, 8, 0.75, (420, 315))])
def test_a_name_without_an_aspect_is_of_a_device_with_its_columns_and_rows_else_of_the_default(
    cols, rows, aspect, tile
):
    """With that aspect for a mesh; a light field's views keep theirs."""
    found = resolve_quilt(named=QuiltName(cols, rows))
    assert (found.layout, found.keeps_aspect) == (QuiltLayout(cols, rows, aspect), True)
    assert found.tile == tile
    assert found.notes == (f"quilt: its name has no aspect; views of a mesh get {aspect:.4g}, others keep their own",)
    assert resolve_quilt(named=QuiltName(cols, rows), aspect=2.0).layout.aspect == 2.0
    assert resolve_quilt(named=QuiltName(cols, rows), aspect=2.0).notes == ()
    with pytest.raises(InvalidOption, match=rf"name says qs{cols}x{rows} and the options say qs8x9a1\.77778; change"):
        resolve_quilt(named=QuiltName(cols, rows), device="65")


def test_a_name_that_says_something_else_is_refused():
    with pytest.raises(InvalidOption, match=r"name says qs11x6a0\.5625 and the options say qs8x6a0\.75; change"):
        resolve_quilt(named=GO_NAME, device="portrait")
