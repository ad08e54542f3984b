"""Shifts, range and misalignment of one view of a light field, of its pictures."""

from ciir.models.light_field.disparities.ranges import measure_ranges
from ciir.models.light_field.disparities.shifts import crop_luma
from ciir.models.light_field.disparities.shifts import measure_shifts as measure_all_shifts


def make_lumas(views):
    return {view: crop_luma(picture) for view, picture in views.items()}


def measure_shifts(views, view, grid):
    return measure_all_shifts(make_lumas(views), [view], grid)[0]


def measure_range(views, view, grid, shifts=None):
    """`shifts`: None: those that are measured."""
    shifts = measure_shifts(views, view, grid) if shifts is None else shifts
    return measure_ranges(make_lumas(views), [view], grid, [shifts])[0][0]


def measure_misalignment(views, view, grid):
    return measure_ranges(make_lumas(views), [view], grid, [measure_shifts(views, view, grid)])[1][0]
