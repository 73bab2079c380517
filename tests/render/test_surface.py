"""Reflectance of rough surfaces: conservation of energy, reciprocity, the formula."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from .test_shaders import evaluate, unit_vectors

pytestmark = pytest.mark.gl

SURFACE = ["render/surface.glsl"]
ROUGHNESS = (0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0)
F0 = 0.04


def sphere_grid(cosines, turns):
    """Directions of a hemisphere and the same share of it, over its projected area, for each."""
    nl = np.sqrt((np.arange(cosines) + 0.5) / cosines)
    turn = (np.arange(turns) + 0.5) / turns * np.pi
    nl, turn = (grid.ravel() for grid in np.meshgrid(nl, turn))
    flat = np.sqrt(1.0 - nl**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), nl], axis=-1)


def test_a_white_furnace_gets_no_brighter(gl):
    """Of white light from all around a white surface sends back all at most, seen from anywhere."""
    light = sphere_grid(300, 300)
    for roughness, to_eye in itertools.product(ROUGHNESS, (0.05, 0.15, 0.3, 0.6, 1.0)):
        eye = f"vec3({np.sqrt(1.0 - to_eye**2)}, 0.0, {to_eye})"
        up = "vec3(0.0, 0.0, 1.0)"
        call = f"vec4(reflectance(vec3(1.0), vec3({F0}), {roughness}, {up}, {eye}, a.xyz), 0.0)"
        got = evaluate(gl, SURFACE, call, np.c_[light, light[:, 0]])[:, 0].astype(float)
        share = float((got / light[:, 2]).mean() * np.pi)
        assert (0.87 if to_eye >= 0.6 else 0.4) <= share <= 1.003, (roughness, to_eye)


def test_reflectance_is_reciprocal(gl):
    light, eye = unit_vectors(400, seed=2), unit_vectors(400, seed=3)
    light[:, 2], eye[:, 2] = np.abs(light[:, 2]) + 0.02, np.abs(eye[:, 2]) + 0.02
    light, eye = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (light, eye))
    for roughness in ROUGHNESS:
        # Two directions in four numbers: x and y of each, z follows.
        call = (
            f"vec4(reflectance(vec3(0.3, 0.5, 0.7), vec3({F0}), {roughness}, vec3(0.0, 0.0, 1.0),"
            " vec3(a.xy, sqrt(1.0 - dot(a.xy, a.xy))), vec3(a.zw, sqrt(1.0 - dot(a.zw, a.zw)))), 0.0)"
        )
        there = evaluate(gl, SURFACE, call, np.c_[eye[:, :2], light[:, :2]])[:, :3] / light[:, 2:]
        back = evaluate(gl, SURFACE, call, np.c_[light[:, :2], eye[:, :2]])[:, :3] / eye[:, 2:]
        assert np.allclose(there, back, rtol=5e-4, atol=1e-6), roughness


def test_rough_ground_is_brightest_with_the_sun_behind_the_eye(gl):
    eye = np.array([np.sin(1.0), 0.0, np.cos(1.0)])
    rows = [[*eye, 0.0], [-eye[0], 0.0, eye[2], 0.0]]
    call = "vec4(reflectance(vec3(0.2), vec3(0.03), 1.0, vec3(0.0, 0.0, 1.0), vec3({}, 0.0, {}), a.xyz), 0.0)"
    behind, ahead = evaluate(gl, SURFACE, call.format(eye[0], eye[2]), rows)[:, 1]
    assert behind > 1.5 * ahead


def test_reflectance_is_its_formula(gl):
    """Hammon's diffuse part and Trowbridge and Reitz's facets, in double precision."""
    g, f0, albedo = 0.49, 0.04, 0.5
    light, eye = unit_vectors(200, seed=7), np.array([0.48, 0.36, 0.8])
    light[:, 2] = np.abs(light[:, 2])
    between = light + eye
    between /= np.linalg.norm(between, axis=1, keepdims=True)
    nl, nh, lh, lv = light[:, 2], between[:, 2], (light * between).sum(axis=1), light @ eye
    facets = g**2 / (np.pi * (nh**2 * (g**2 - 1.0) + 1.0) ** 2)
    smith = 0.5 / (2.0 * nl * eye[2] * (1.0 - g) + (nl + eye[2]) * g)
    facing = 0.5 + 0.5 * lv
    rough = facing * (0.9 - 0.4 * facing) * (0.5 + nh) / nh
    even = 1.05 * (1.0 - f0) * (1.0 - (1.0 - nl) ** 5) * (1.0 - (1.0 - eye[2]) ** 5)
    inside = albedo * ((even + (rough - even) * g) / np.pi + 0.1159 * g * albedo) / (1.03 + 0.165 * g**3)
    expected = nl * (inside + (f0 + (1.0 - f0) * (1.0 - lh) ** 5) * facets * smith)
    up, to_eye = "vec3(0.0, 0.0, 1.0)", "vec3(0.48, 0.36, 0.8)"
    call = f"vec4(reflectance(vec3(0.5), vec3(0.04), 0.7, {up}, {to_eye}, a.xyz), 0.0)"
    got = evaluate(gl, SURFACE, call, np.c_[light, nl])[:, 0]
    assert np.allclose(got, expected, rtol=1e-4, atol=1e-6)
