"""The sky without tables: sums over many short steps, and photons one by one, in double precision."""

import numpy as np

from sketchterrain.render.atmosphere import AEROSOL_ABSORBED, GROUND, GROUND_ALBEDO, TOP

NEAR = np.polynomial.legendre.leggauss(400)


def optical_depth(air, height, cosine):
    """To the top of the air from a height (m), by 800 steps; (3,)."""
    r = GROUND + height
    way = -r * cosine + np.sqrt(r * r * (cosine * cosine - 1.0) + TOP**2)
    perigee = np.clip(-r * cosine, 0.0, way)
    total = np.zeros(3)
    for start, stop in ((0.0, perigee), (perigee, way)):
        along = start + 0.5 * (NEAR[0] + 1.0) * (stop - start)
        heights = np.sqrt(r * r + along**2 + 2.0 * r * along * cosine) - GROUND
        total += (air.scattering(heights)[2] * (0.5 * NEAR[1] * (stop - start))[:, None]).sum(axis=0)
    return total


def photons(air, channel, cosine, count, seed):
    """Share of sunlight that reaches level ground from the sky, by photons through flat layers of air.

    Woodcock's tracking, with all orders of scattering, both phase functions and the ground's albedo.
    """
    rng = np.random.default_rng(seed)
    ceiling = TOP - GROUND
    most = float(air.scattering(np.zeros(1))[2][0, channel])
    z = np.full(count, ceiling)
    way = np.tile([np.sqrt(1.0 - cosine**2), 0.0, -cosine], (count, 1))
    weight, flown = np.ones(count), np.zeros(count, bool)
    diffuse = 0.0
    for _ in range(4000):
        step = -np.log(rng.random(len(z))) / most
        z = z + way[:, 2] * step
        ground = z < 0.0
        diffuse += weight[ground & flown].sum()
        z[ground] = 0.0
        weight[ground] *= GROUND_ALBEDO[channel]
        up = np.sqrt(rng.random(ground.sum()))
        turn = 2.0 * np.pi * rng.random(ground.sum())
        flat = np.sqrt(1.0 - up * up)
        way[ground] = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=-1)
        flown |= ground
        rayleigh, aerosol, extinction = (each[:, channel] for each in air.scattering(z))
        drawn = rng.random(len(z)) * most
        met = ~ground & (drawn < extinction) & (z < ceiling)
        by_air = rng.random(len(z)) * (rayleigh + aerosol) < rayleigh
        weight[met] *= ((rayleigh + aerosol) / extinction)[met]
        way[met] = _turned(way[met], _angle(rng, by_air[met]), rng)
        flown |= met
        alive = (z < ceiling) & (weight > 1e-3) if _ else weight > 0.0
        z, way, weight, flown = z[alive], way[alive], weight[alive], flown[alive]
        if not len(z):
            break
    return diffuse / count


def _angle(rng, by_air):
    """Cosines of angles of scattering, by molecules or by aerosols (Cornette & Shanks, by rejection)."""
    cosine = np.empty(len(by_air))
    u = 4.0 * rng.random(len(by_air)) - 2.0
    cubic = np.cbrt(u + np.sqrt(u * u + 1.0))
    cosine[by_air] = (cubic - 1.0 / cubic)[by_air]
    g, left = 0.76, np.flatnonzero(~by_air)
    while len(left):
        s = (1.0 - g * g) / (1.0 - g + 2.0 * g * rng.random(len(left)))
        trial = (1.0 + g * g - s * s) / (2.0 * g)
        taken = rng.random(len(left)) * 2.0 < 1.0 + trial * trial
        cosine[left[taken]] = trial[taken]
        left = left[~taken]
    return cosine


def _turned(way, cosine, rng):
    turn = 2.0 * np.pi * rng.random(len(way))
    helper = np.where(np.abs(way[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(way, helper)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(way, side)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return (
        cosine[:, None] * way + (sine * np.cos(turn))[:, None] * side + (sine * np.sin(turn))[:, None] * other
    )


def share_aerosols_take(air):
    """Vertical optical depth of aerosols, in closed form; (3,)."""
    return air.scattering(np.zeros(1))[1][0] * (1.0 + AEROSOL_ABSORBED)
