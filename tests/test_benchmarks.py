"""The benchmarks' own instruments: what they measure is what they say."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import peers
from benchmarks.channels import CHANNELS
from benchmarks.measure import deviation, examine, faces_of, spline_of, true_points
from pc2cad.compiler import compile_equation

TUBE = CHANNELS[3]


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.name)
def test_the_functions_of_the_peers_are_the_maps_of_the_templates(channel):
    channel.check()


def test_the_distance_to_a_surface_is_found_across_its_seam():
    part = compile_equation(TUBE.equation(), 1e-5)
    outer = [face for side, face in part.faces.items() if side == "w=1"]
    assert deviation(TUBE, outer, (1.0,)) <= 1e-5
    # points of the wall pushed outwards by a known length are that far away
    surface = spline_of(outer[0])
    v = np.linspace(0, 1, 41)
    u = np.linspace(0.1, 0.9, 41)
    centre, wall = TUBE.guide_points(u), TUBE.points(1.0, u, v)
    out = (wall - centre) / np.linalg.norm(wall - centre, axis=1, keepdims=True)
    for length in (1e-2, 0.2):
        assert surface.distances(wall + length * out) == pytest.approx(length, abs=1e-5)


def test_a_wrong_wall_is_seen():
    part = compile_equation(TUBE.equation(), 1e-5)
    inner = [face for side, face in part.faces.items() if side == "w=0"]
    assert deviation(TUBE, inner, (1.0,)) == pytest.approx(TUBE.delta, abs=1e-3)
    assert true_points(TUBE, 1.0).shape[1] == 3


def test_solids_are_told_from_faces_and_from_open_shells():
    part = compile_equation(TUBE.equation(), 1e-5)
    volume = part.report.equation.volume
    found = examine(part.shape, volume)
    assert found.valid
    assert abs(found.volume_error) < 1e-6
    assert not examine(faces_of(part.shape)[0], volume).valid
    assert examine(part.shape, 2 * volume).volume_error == pytest.approx(-0.5, abs=1e-6)


@pytest.mark.slow
def test_the_sweep_without_a_boolean_is_the_same_solid():
    shape, tolerance = peers.sewn(TUBE, peers.pipe_face(None), 1)
    volume = compile_equation(TUBE.equation(), 1e-5).report.equation.volume
    assert tolerance <= 1e-6
    assert examine(shape, volume).valid
    assert 1e-6 < deviation(TUBE, faces_of(shape), (0.0, 1.0)) < 1e-4


def test_counts_of_work_that_grow_by_more_than_a_tenth_are_told() -> None:
    from benchmarks.work import TABLE, TEMPLATES, grown

    kept = json.loads(TABLE.read_text())
    assert set(kept) == set(TEMPLATES)
    assert grown(kept, kept) == []
    slower = {**kept, "torus": {"calls": 5}}
    slower["channel_ellipse"] = {**kept["channel_ellipse"], "cells": 2000, "poles": 1927}
    assert grown(kept, slower) == [
        f"channel_ellipse: cells {kept['channel_ellipse']['cells']} -> 2000 "
        f"({2000 / kept['channel_ellipse']['cells'] - 1:+.0%})",
        "torus: calls 5, and none is kept",
    ]


@pytest.mark.parametrize("channel", CHANNELS, ids=lambda channel: channel.name)
def test_no_two_timed_runs_are_given_the_same_numbers(channel):
    first, second = channel.another(), channel.another()
    assert len({channel.text, first.text, second.text}) == 3
    assert (first.a == first.b) == (channel.a == channel.b)
    for other in (first, second):
        other.check()
        assert other.a == pytest.approx(channel.a, rel=1e-3)
