"""Which views lie around which, in each wrong order."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ciir.models.light_field.windows import list_required_views
from ciir.renderer.view_order.estimate import OrderEstimate
from ciir.renderer.view_order.evidence import ORDERS
from ciir.service.pipeline.stages.arrangement import Arrangement, arrange_views
from tests.support.light_fields import put_in, wind


def name_views(grid):
    """An array whose "pixels" are the row and column of each view: `(V, U, 1, 1, 2)`."""
    return np.moveaxis(np.indices(grid), 0, -1)[:, :, None, None]


@given(
    st.data(), st.tuples(st.integers(3, 7), st.integers(3, 7)), st.sampled_from(list(product(ORDERS, (False, True))))
)
def test_windows_are_those_of_the_right_order(data, grid, how):
    order, winds = how
    views = put_in(order, name_views(grid))
    views = wind(views) if winds else views
    right = {tuple(views[view].ravel().tolist()): view for view in np.ndindex(views.shape[:2])}
    got = arrange_views(views.shape[:2], OrderEstimate(order, 9, 9, winds))
    assert got.grid == grid
    place = data.draw(st.tuples(st.integers(0, grid[0] - 1), st.integers(0, grid[1] - 1)))
    assert got.find_place(right[place]) == place
    assert got.list_required([right[place]]) == [right[other] for other in list_required_views([place], grid)]


@pytest.mark.parametrize("order", [None, OrderEstimate("transposed", 4, 9), OrderEstimate("as given", 9, 9)])
def test_views_stay_where_no_order_is_certainly_wrong(order):
    got = arrange_views((3, 5), order)
    assert got == Arrangement((3, 5))
    assert got.list_required([(0, 0)]) == list_required_views([(0, 0)], (3, 5))
