#!/usr/bin/env python3
"""Blind stacks from a simulator that shares nothing with atomcam.

Its own point-spread function (the pupil's field summed up at every site), its own noise laws and random numbers, its own
order of operations (whole stacks at once), and its own form of every effect, some of which are in no catalogue. What a
diagnosis makes of them tells how much it leans on its own simulator:

    tests/diagnosis/foreign_stacks.py -n 24 -o foreign
    atomcam blind score foreign

writes foreign/NNNN/{frames.tif,darks.tif,lab.json} and foreign/seals/NNNN.json, as `atomcam blind make` does. Strength 1
is weak, 2 clear, 3 strong to this author's eye.
"""

import argparse
import json
import struct
from pathlib import Path

import numpy as np

FINE = 3  # subpixels along a pixel's side where images move
EFFECTS = {}  # name: (stage, cameras, function)
MEMBER = set()  # names that are in atomcam's catalogue


def effect(stage, cameras="emccd qcmos", listed=True):
    def add(function):
        EFFECTS[function.__name__] = (stage, cameras.split(), function)
        if listed:
            MEMBER.add(function.__name__)
        return function

    return add


def usual_lab(rng, emccd):
    """Set-points as they are noted: always the same but for the exposure."""
    return {
        "exposure": rng.uniform(0.05, 0.12),
        "magnification": 78.125 if emccd else 30.0,
        "aperture": 0.65,
        "wavelength": 0.461,
        "stray": 2.0 if emccd else 4.0,
        "filling": 0.55,
        "em_gain": 300.0,
        "preamp": 4.85 if emccd else 0.107,
        "bias": 200.0,
    }


def any_lab(lab, rng, emccd):
    """Other set-points, and any grid that fits: its spacing, and how many rows and columns are left out of it."""
    u = rng.uniform
    wavelength, aperture = ((0.461, 0.65), (0.556, 0.6), (0.78, 0.55))[int(rng.integers(3))]
    lab |= {"wavelength": wavelength, "aperture": aperture, "exposure": float(np.exp(u(np.log(0.02), np.log(0.3))))}
    lab["magnification"] *= u(0.85, 1.3) * aperture / wavelength * 0.461 / 0.65  # about as sharp in pixels
    lab["stray"] *= float(np.exp(u(np.log(0.3), np.log(4))))
    lab["filling"] = u(0.35, 0.9)
    if emccd:
        lab["em_gain"] = float(rng.choice([100.0, 200.0, 500.0, 900.0]))
        lab["preamp"] = float(rng.choice([4.85, 9.2, 15.5]))
    lab["bias"] = float(rng.choice([100.0, 300.0, 500.0]))
    lab["spacing"] = u(7, 16)
    lab["left_out"] = [int(v) for v in rng.integers(0, 4, 2)]
    return lab


class Stack:
    """One lab and the arrays that become its frames, effects having their say in between."""

    def __init__(self, rng, camera, frames, darks, size, apodisation=0.0, other_labs=None):
        self.rng, self.camera, self.size = rng, camera, size
        self.count, self.dark_count = frames, darks
        self.emccd = camera == "emccd"
        self.hooks = {"light": [], "fine": [], "mean": [], "electrons": [], "signal": [], "counts": []}
        u = rng.uniform
        self.noted = usual_lab(rng, self.emccd)
        if other_labs is not None:
            self.noted = any_lab(self.noted, other_labs, self.emccd)
        self.exposure = self.noted["exposure"]
        self.pixel, self.magnification = 16.0 if self.emccd else 4.6, self.noted["magnification"]
        self.wavelength, self.aperture = self.noted["wavelength"], self.noted["aperture"]
        self.quantum_efficiency = 0.86 if self.emccd else 0.85
        self.noted_rate, self.noted_stray = 30000.0, self.noted["stray"]
        collected = 0.5 * (1 - np.sqrt(1 - self.aperture**2))
        self.electrons_per_atom = (
            self.noted_rate * u(0.8, 1.3) * self.exposure * collected * self.quantum_efficiency
        )
        self.stray = self.noted_stray * u(0.6, 1.7) * self.exposure
        self.filling = min(0.97, u(0.45, 0.7) - 0.55 + self.noted["filling"])
        self.survival = u(0.93, 0.995)
        self.bias = self.noted["bias"] + u(-3, 3)
        if self.emccd:
            self.em_gain, self.electrons_per_count = self.noted["em_gain"] * u(0.8, 1.2), self.noted["preamp"]
            self.read_noise = 4 * u(0.9, 1.15)
            self.dark = 0.002 * u(0.7, 1.4) + 3e-4 * self.exposure
        else:
            self.em_gain, self.electrons_per_count = 1, 0.107 * u(0.92, 1.08)
            self.read_noise = 4 * u(0.9, 1.15)
            shape = (size, size)
            self.dark = rng.gamma(2.0, 0.006 * u(0.7, 1.4) * self.exposure / 2.0, shape)
            self.offsets = (
                rng.normal(0, u(0.4, 0.8), shape)
                + rng.gumbel(0, u(0.05, 0.2), (1, size))
                + rng.normal(0, u(0.05, 0.2), (size, 1))
            )
            self.noise_map = self.read_noise * np.maximum(0.3, rng.normal(1, u(0.03, 0.1), shape))
        spacing = u(8.6, 11.5)
        left_out = [int(rng.integers(0, 2)) for _ in range(2)]
        spacing, left_out = self.noted.get("spacing", spacing), self.noted.get("left_out", left_out)
        self.grid_rows, self.grid_cols = (max(2, int((size - 20) / spacing) + 1 - n) for n in left_out)
        self.spacing = spacing
        first = [0.5 * (size - 1 - (n - 1) * spacing) for n in (self.grid_cols, self.grid_rows)]
        self.noted_first = [round(v, 1) for v in first]
        angle = np.deg2rad(u(-0.5, 0.5))
        columns, rows = np.meshgrid(np.arange(self.grid_cols), np.arange(self.grid_rows))
        self.lattice = (rows.ravel(), columns.ravel())
        true_spacing = spacing * u(0.997, 1.003)
        x, y = columns.ravel() * true_spacing, rows.ravel() * true_spacing
        self.x = first[0] + u(-0.8, 0.8) + x * np.cos(angle) - y * np.sin(angle)
        self.y = first[1] + u(-0.8, 0.8) + x * np.sin(angle) + y * np.cos(angle)
        self.sites = self.x.size
        # Wavefront per site: Noll terms 4 (defocus) to 11, um rms.
        common = np.concatenate([[u(0.0, 0.07)], u(-0.012, 0.012, 7)])
        self.wavefront = np.tile(common, (self.sites, 1))
        self.apodisation = apodisation
        self.brightness = np.ones(self.sites)
        self.blur = None  # transfer function of (fx, fy), cycles per px
        self.shifts = None  # (frames, 2) in px
        self.scatter = 0  # of every atom in every frame, px rms
        self.background = np.ones((size, size))  # relative map of stray light
        self.response = np.ones((size, size))

    def on(self, plane, function):
        self.hooks[plane].append(function)

    def run(self, plane, values, dark=False):
        for function in self.hooks[plane]:
            values = function(values, dark)
        return values

    def site_images(self):
        """(sites, size * FINE, size * FINE), each of sum 1 but for what falls off the sensor."""
        n, reach = 128, self.size  # the field repeats after more than twice the frame
        axis = (np.arange(n) + 0.5) / n * 2 - 1
        px, py = np.meshgrid(axis, axis)
        r2, theta = px**2 + py**2, np.arctan2(py, px)
        r = np.sqrt(r2)
        inside = r2 <= 1
        zernike = np.array([
            np.sqrt(3) * (2 * r2 - 1),
            np.sqrt(6) * r2 * np.sin(2 * theta),
            np.sqrt(6) * r2 * np.cos(2 * theta),
            np.sqrt(8) * (3 * r**3 - 2 * r) * np.sin(theta),
            np.sqrt(8) * (3 * r**3 - 2 * r) * np.cos(theta),
            np.sqrt(8) * r**3 * np.sin(3 * theta),
            np.sqrt(8) * r**3 * np.cos(3 * theta),
            np.sqrt(5) * (6 * r2**2 - 6 * r2 + 1),
        ])
        # High-aperture objectives dim the pupil's edge: a power of the cosine of the ray's angle.
        amplitude = inside * (1 - self.aperture**2 * np.minimum(r2, 1)) ** self.apodisation
        cutoff = self.aperture / self.wavelength * self.pixel / self.magnification  # cycles per px
        step = 1 / (2 * FINE)  # two samples along a fine pixel
        images = np.zeros((self.sites, self.size * FINE, self.size * FINE), np.float32)
        for s in range(self.sites):
            field = amplitude * np.exp(2j * np.pi / self.wavelength * np.tensordot(self.wavefront[s], zernike, 1))
            column, row = int(round(self.x[s])), int(round(self.y[s]))
            at = (np.arange(2 * FINE * (2 * reach + 1)) + 0.5) * step - 0.5 - reach
            to_x = np.exp(-2j * np.pi * cutoff * np.outer(at + column - self.x[s], axis))
            to_y = np.exp(-2j * np.pi * cutoff * np.outer(at + row - self.y[s], axis))
            light = np.abs(to_y @ field @ to_x.T) ** 2
            light = light.reshape(light.shape[0] // 2, 2, -1, 2).sum((1, 3))
            # Parseval: all the light of the pupil, what lands beyond the patch included.
            light *= (2 / n * cutoff * step) ** 2 / np.sum(amplitude**2)
            top, left = (row - reach) * FINE, (column - reach) * FINE
            y0, x0 = max(0, -top), max(0, -left)
            y1, x1 = (min(light.shape[k], self.size * FINE - o) for k, o in ((0, top), (1, left)))
            images[s, top + y0 : top + y1, left + x0 : left + x1] = light[y0:y1, x0:x1]
        return images

    def exposures(self):
        """(frames, sites): how long each site shone, in parts of the exposure."""
        shape = (self.count, self.sites)
        here = self.rng.random(shape) < self.filling
        lost = self.rng.exponential(-1 / np.log(self.survival), shape)
        return np.where(here, np.minimum(1, lost), 0)

    def mean_light(self):
        light = self.run("light", self.exposures()) * self.brightness
        images = self.site_images()
        if self.scatter:
            mean = self.scattered(light, images)
        elif self.shifts is None and self.blur is None and not self.hooks["fine"]:
            mean = light.astype(np.float32) @ self.binned(images).reshape(self.sites, -1)
            mean = mean.reshape(self.count, self.size, self.size)
        else:
            mean = np.empty((self.count, self.size, self.size), np.float32)
            frequency = np.fft.fftfreq(self.size * FINE) * FINE  # cycles per px
            fx, fy = np.meshgrid(frequency, frequency)
            blur = np.ones_like(fx) if self.blur is None else self.blur(fx, fy)
            flat = images.reshape(self.sites, -1)
            for n in range(self.count):
                fine = self.run("fine", (light[n].astype(np.float32) @ flat).reshape(fx.shape))
                shift = (0, 0) if self.shifts is None else self.shifts[n]
                moved = np.fft.ifft2(
                    np.fft.fft2(fine) * blur * np.exp(-2j * np.pi * (fx * shift[0] + fy * shift[1]))
                ).real
                mean[n] = self.binned(moved)
        return np.maximum(mean, 0) * self.electrons_per_atom + self.stray * self.background

    def binned(self, images):
        """Fine images in whole pixels."""
        return images.reshape(*images.shape[:-2], self.size, FINE, self.size, FINE).sum((-3, -1))

    def scattered(self, light, images):
        """Each atom's image between the nine that are a whole pixel or none away; farther ones are cut off."""
        off = np.clip(self.scatter * self.rng.normal(0, 1, (2, *light.shape)), -1, 1)
        mean = np.zeros((self.count, self.size * self.size), np.float32)
        # Parabolic weights keep the second moment of what is displaced.
        weights = [[0.5 * v * (v - 1), 1 - v * v, 0.5 * v * (v + 1)] for v in off]
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                pixels = self.binned(np.roll(images, (dy * FINE, dx * FINE), (1, 2)))
                share = (light * weights[0][dx + 1] * weights[1][dy + 1]).astype(np.float32)
                mean += share @ pixels.reshape(self.sites, -1)
        return mean.reshape(self.count, self.size, self.size)

    def expose(self, dark):
        count = self.dark_count if dark else self.count
        rng = self.rng
        mean = np.zeros((count, self.size, self.size)) if dark else self.mean_light()
        mean = self.run("mean", mean, dark) * self.response + self.dark
        electrons = self.run("electrons", rng.poisson(mean).astype(float), dark)
        if self.emccd:
            signal = np.zeros_like(electrons)
            some = electrons > 0
            signal[some] = rng.gamma(electrons[some], self.em_gain)
        else:
            signal = electrons
        signal = self.run("signal", signal, dark) / self.electrons_per_count
        if self.emccd:
            counts = signal + self.bias + rng.normal(0, self.read_noise, signal.shape)
        else:
            counts = signal + self.bias + self.offsets + rng.normal(0, 1, signal.shape) * self.noise_map
        counts = self.run("counts", counts, dark)
        return np.clip(np.rint(counts), 0, 65535).astype(np.uint16)

    def notes(self):
        settings = {
            "quantum_efficiency": self.quantum_efficiency,
            "exposure_s": self.exposure,
            "preamp_e_per_adu": self.noted["preamp"],
            "bias_adu": self.noted["bias"],
            "read_noise_adu": 4.0,
            "dark_e_per_s": 3e-4 if self.emccd else 0.006,
            "pixel_um": self.pixel,
            "magnification": self.magnification,
            "numerical_aperture": self.aperture,
            "wavelength_um": self.wavelength,
            "scattering_rate_hz": self.noted_rate,
            "stray_e_per_s": self.noted_stray,
            "filling": round(self.noted["filling"], 2),
            "survival": 0.97,
        }
        if self.emccd:
            settings |= {"em_gain": self.noted["em_gain"], "cic_e": 0.002}
        return {
            "camera": "iXon Ultra 897" if self.emccd else "ORCA-Quest",
            "shape": [self.size, self.size],
            "settings": settings,
            "site_grid": {
                "rows": self.grid_rows,
                "cols": self.grid_cols,
                "spacing_px": round(self.spacing, 2),
                "first_site_px": self.noted_first,
                "angle_deg": 0.0,
            },
        }

    def field(self):
        """Sites' positions from the middle, -1 to 1 at the sensor's edges."""
        half = 0.5 * (self.size - 1)
        return (self.x - half) / half, (self.y - half) / half

    def pixels(self):
        half = 0.5 * (self.size - 1)
        rows, columns = np.mgrid[: self.size, : self.size]
        return (columns - half) / half, (rows - half) / half

    def blur_frames(self, width):
        """Every frame's image by its own width, px rms."""
        state = {"n": 0}

        def blur(fine, dark):
            sigma = width[state["n"] % self.count] * FINE
            state["n"] += 1
            f = np.fft.fftfreq(fine.shape[0])
            fx, fy = np.meshgrid(f, f)
            return np.fft.ifft2(np.fft.fft2(fine) * np.exp(-2 * np.pi**2 * sigma**2 * (fx**2 + fy**2))).real

        self.on("fine", blur)

    def vary_stray_light(self, level):
        """Level of the stray light alone, one a frame, relative."""

        def vary(mean, dark):
            return mean if dark else mean + self.stray * self.background * (level - 1)[:, None, None]

        self.on("mean", vary)

    def slow(self, count, memory):
        """Normal values of unit rms, smooth over `memory` frames."""
        width = max(1, int(3 * memory))
        kernel = np.exp(-0.5 * (np.arange(-width, width + 1) / memory) ** 2)
        noise = self.rng.normal(0, 1, count + 2 * width)
        return np.convolve(noise, kernel / np.sqrt(np.sum(kernel**2)), "valid")


# ---------------------------------------------------------------------------------------------------------------------
# In the catalogue. `k` is 0.5, 1, 2 for strengths 1, 2, 3.


@effect("scene")
def site_brightness_spread(s, k):
    s.brightness *= np.maximum(0.05, 1 + 0.1 * k * s.rng.normal(0, 1, s.sites))


@effect("scene")
def site_position_scatter(s, k):
    s.x = s.x + 0.12 * k * s.rng.normal(0, 1, s.sites)
    s.y = s.y + 0.12 * k * s.rng.normal(0, 1, s.sites)


@effect("scene")
def fluorescence_drift(s, k):
    drift = 1 + 0.05 * k * s.slow(s.count, s.rng.uniform(60, 200))
    s.on("light", lambda light, dark: light * drift[:, None])


@effect("scene")
def frame_intensity_noise(s, k):
    noise = np.exp(0.05 * k * s.rng.normal(0, 1, s.count))
    s.on("light", lambda light, dark: light * noise[:, None])


@effect("scene")
def atom_hopping(s, k):
    def hop(light, dark):
        rows, columns = s.lattice
        for n, a in np.argwhere((light > 0) & (s.rng.random(light.shape) < 0.05 * k)):
            steps = [(0, 1), (0, -1), (1, 0), (-1, 0)]
            dr, dc = steps[s.rng.integers(4)]
            rest = s.rng.random() * light[n, a]
            light[n, a] -= rest
            near = np.flatnonzero((rows == rows[a] + dr) & (columns == columns[a] + dc))
            if near.size:  # on a filled site both are lost, at some time of the rest
                if light[n, near[0]] > 0:
                    light[n, near[0]] = min(light[n, near[0]], 1 - rest)
                else:
                    light[n, near[0]] = rest
        return light

    s.on("light", hop)


@effect("scene")
def blinking(s, k):
    dark_time, dark_share = s.exposure * s.rng.uniform(0.03, 0.2), min(0.5, 0.15 * k)
    bright_time = dark_time * (1 - dark_share) / dark_share

    def blink(light, dark):
        out = np.zeros_like(light)
        steps = 200
        state = s.rng.random(light.shape) > dark_share
        dt = s.exposure / steps
        for step in range(steps):
            out += state * np.clip(light * steps - step, 0, 1) / steps
            flip = s.rng.random(light.shape) < dt / np.where(state, bright_time, dark_time)
            state = state ^ flip
        return out

    s.on("light", blink)


@effect("optics")
def field_tilt_defocus(s, k):
    x, y = s.field()
    angle = s.rng.uniform(0, 2 * np.pi)
    s.wavefront[:, 0] += 0.05 * k * (x * np.cos(angle) + y * np.sin(angle))


@effect("optics")
def pupil_apodisation(s, k):
    s.apodisation += 0.2 * k


@effect("optics")
def vibration_jitter(s, k):
    """A slow line motion, and a fast one on the round, of other directions."""
    rms = 0.3 * k
    slow = s.rng.uniform(0.2, 0.8)
    angle = s.rng.uniform(0, np.pi)
    along = rms * np.sqrt(slow) * s.rng.normal(0, 1, s.count)
    s.shifts = np.stack([along * np.cos(angle), along * np.sin(angle)], 1)
    fast = rms * np.sqrt(1 - slow)
    s.blur = lambda fx, fy: np.exp(-2 * np.pi**2 * fast**2 * 0.5 * (fx**2 + fy**2))


@effect("optics")
def pointing_drift(s, k):
    memory = s.rng.uniform(15, 60)
    s.shifts = 0.15 * k * np.stack([s.slow(s.count, memory), s.slow(s.count, memory)], 1)


@effect("optics")
def scatter_halo(s, k):
    share, scale = min(0.4, 0.08 * k), s.rng.uniform(6, 20)
    x, y = s.pixels()
    half = 0.5 * (s.size - 1)
    kernel = np.exp(-np.hypot(x, y) * half / scale)
    pad = 2 * s.size
    transform = np.fft.rfft2(kernel / kernel.sum(), (pad, pad))

    def scatter(mean, dark):
        if dark:
            return mean
        o = (s.size - 1) // 2
        for n in range(len(mean)):
            light = mean[n] - s.stray * s.background
            wide = np.fft.irfft2(np.fft.rfft2(light, (pad, pad)) * transform, (pad, pad))
            mean[n] = s.stray * s.background + (1 - share) * light + share * wide[o : o + s.size, o : o + s.size]
        return mean

    s.on("mean", scatter)


@effect("optics")
def stray_light_gradient(s, k):
    x, y = s.pixels()
    angle = s.rng.uniform(0, 2 * np.pi)
    s.background = s.background * np.maximum(0, 1 + 0.35 * k * (x * np.cos(angle) + y * np.sin(angle)))


@effect("optics")
def vignetting(s, k):
    x, y = s.pixels()
    r2 = (x**2 + y**2) / 2
    fall = 1 - min(0.7, 0.25 * k) * r2
    s.on("mean", lambda mean, dark: mean * fall)


@effect("optics")
def etaloning_fringes(s, k):
    x, y = s.pixels()
    half = 0.5 * (s.size - 1)
    period, angle, phase = s.rng.uniform(12, 30), s.rng.uniform(0, np.pi), s.rng.uniform(0, 2 * np.pi)
    along = (x * np.cos(angle) + y * np.sin(angle)) * half + 2 * (x**2 + y**2)
    fringes = 1 + 0.1 * k * np.sin(2 * np.pi * along / period + phase)
    s.on("mean", lambda mean, dark: mean * fringes)


@effect("sensor")
def hot_pixels(s, k):
    hot = (s.rng.random((s.size, s.size)) < 0.002 * k) * s.rng.lognormal(0, 0.7, (s.size, s.size))
    s.dark = s.dark + hot * (0.05 if s.emccd else 3)


@effect("sensor")
def cosmic_rays(s, k):
    def rays(electrons, dark):
        for frame in electrons:
            for _ in range(s.rng.poisson(0.06 * k)):
                x, y = s.rng.uniform(0, s.size, 2)
                angle, length = s.rng.uniform(0, 2 * np.pi), s.rng.exponential(4)
                for t in np.arange(0, length + 0.5, 0.5):
                    c, r = int(x + t * np.cos(angle)), int(y + t * np.sin(angle))
                    if 0 <= c < s.size and 0 <= r < s.size:
                        frame[r, c] += s.rng.poisson(300)
        return electrons

    s.on("electrons", rays)


@effect("sensor")
def pixel_crosstalk(s, k):
    """Electrons hop to one of the four neighbours, each by itself."""
    share = 0.03 * k

    def leak(electrons, dark):
        out = np.zeros_like(electrons)
        left = electrons.astype(int)
        for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            moved = s.rng.binomial(np.maximum(left, 0), min(0.2, share / 4))
            left = left - moved
            out += np.roll(moved, (dr, dc), (1, 2))
        return out + left

    s.on("electrons", leak)


@effect("sensor")
def image_lag(s, k):
    share = 0.02 * k

    def lag(electrons, dark):
        out = electrons.copy()
        out[1:] += s.rng.poisson(share * electrons[:-1])
        return out

    s.on("electrons", lag)


@effect("sensor", "emccd")
def frame_transfer_smear(s, k):
    share = 0.03 * k

    def smear(mean, dark):
        if dark:
            return mean
        light = mean - s.stray * s.background
        return mean + share * light.mean(1, keepdims=True)

    s.on("mean", smear)


@effect("sensor", "emccd")
def serial_cic(s, k):
    def serial(signal, dark):
        events = s.rng.poisson(0.03 * k, signal.shape)
        some = events > 0
        depth = s.rng.random(int(some.sum()))
        signal[some] += s.rng.exponential(s.em_gain**depth)
        return signal

    s.on("signal", serial)


@effect("sensor", "emccd")
def cti_tail(s, k):
    share, length = 0.025 * k, s.rng.uniform(0.7, 2.5)

    def trail(signal, dark):
        kept = np.zeros(signal.shape[:2])
        out = np.empty_like(signal)
        decay = np.exp(-1 / length)
        for c in range(signal.shape[2]):
            out[:, :, c] = signal[:, :, c] * (1 - share) + kept * (1 - decay)
            kept = kept * decay + share * signal[:, :, c]
        return out

    s.on("signal", trail)


@effect("sensor")
def pixel_response_nonuniformity(s, k):
    s.response = s.response * np.maximum(0.1, s.rng.normal(1, 0.06 * k, s.response.shape))


@effect("sensor")
def nonlinearity(s, k):
    full = (120000 if s.emccd else 1200) / k

    s.on("signal", lambda signal, dark: full * (1 - np.exp(-np.minimum(signal, 5 * full) / full)))


@effect("sensor")
def random_telegraph_noise(s, k):
    chosen = np.argwhere(s.rng.random((s.size, s.size)) < 0.01 * k)
    step = 2.5 * s.read_noise
    rate = s.rng.uniform(0.02, 0.2, len(chosen))

    def jump(counts, dark):
        for (r, c), p in zip(chosen, rate):
            flips = s.rng.random(len(counts)) < p
            counts[:, r, c] += step * ((np.cumsum(flips) + s.rng.integers(2)) % 2 - 0.5)
        return counts

    s.on("counts", jump)


@effect("sensor")
def dual_adc_peaks(s, k):
    chosen = s.rng.random((s.size, s.size)) < 0.015 * k
    step = 3 * s.read_noise

    s.on("counts", lambda counts, dark: counts + chosen * step * (s.rng.random(counts.shape) < 0.5))


@effect("sensor")
def row_noise(s, k):
    def noise(counts, dark):
        return counts + s.rng.normal(0, 0.15 * k * s.read_noise, (len(counts), s.size, 1))

    s.on("counts", noise)


@effect("sensor")
def emi_stripes(s, k):
    period, row_turns = s.rng.uniform(4, 40), s.rng.random()

    def stripes(counts, dark):
        phase = 2 * np.pi * np.cumsum(s.rng.normal(0, 0.3, len(counts)))[:, None, None]
        rows, columns = np.mgrid[: s.size, : s.size]
        return counts + 0.2 * k * s.read_noise * np.sin(2 * np.pi * (columns / period + rows * row_turns) + phase)

    s.on("counts", stripes)


@effect("sensor")
def bias_drift(s, k):
    memory = s.rng.uniform(10, 80)
    s.on("counts", lambda counts, dark: counts + 0.08 * k * s.read_noise * s.slow(len(counts), memory)[:, None, None])


# ---------------------------------------------------------------------------------------------------------------------
# In no catalogue.


@effect("scene", listed=False)
def beam_profile(s, k):
    x, y = s.field()
    s.brightness *= np.exp(-0.35 * k * ((x - 0.6) ** 2 + 0.2 * y**2))


@effect("scene", listed=False)
def pair_loading(s, k):
    """Now and then two atoms in a trap."""
    s.on("light", lambda light, dark: light * (1 + (s.rng.random(light.shape) < 0.04 * k)))


@effect("scene", listed=False)
def state_pumping(s, k):
    """Atoms fall into a state that is half as bright, and stay there."""

    def pump(light, dark):
        at = s.rng.exponential(1 / (0.25 * k), light.shape)
        return np.minimum(light, at) + 0.5 * np.maximum(0, light - at)

    s.on("light", pump)


@effect("scene", listed=False)
def common_loading(s, k):
    """The whole array is filled better in some frames than in others."""

    def load(light, dark):
        keep = np.clip(1 - 0.2 * k * np.abs(s.rng.normal(0, 1, (s.count, 1))), 0, 1)
        return light * (s.rng.random(light.shape) < keep)

    s.on("light", load)


@effect("scene", listed=False)
def memory_of_filling(s, k):
    def remember(light, dark):
        for n in range(1, len(light)):
            same = s.rng.random(s.sites) < 0.2 * k
            light[n] = np.where(same, light[n - 1], light[n])
        return light

    s.on("light", remember)


@effect("scene", listed=False)
def dead_sites(s, k):
    """Some traps hardly ever hold an atom."""
    weak = s.rng.random(s.sites) < 0.06 * k

    s.on("light", lambda light, dark: light * ~(weak & (s.rng.random(light.shape) < 0.8)))


@effect("scene", listed=False)
def filling_drift(s, k):
    """Traps load ever worse while the stack is taken."""
    kept = np.linspace(1, 1 - 0.2 * k, s.count)[:, None]

    s.on("light", lambda light, dark: light * (s.rng.random(light.shape) < kept))


@effect("scene", listed=False)
def thermal_motion(s, k):
    """Every atom is somewhere else in its trap in every frame."""
    s.scatter = 0.2 * k


@effect("scene", listed=False)
def uneven_survival(s, k):
    """Traps at one side of the array are shallower, and atoms leave them sooner."""
    lost = np.clip(0.12 * k * (1 + s.field()[0]), 0, 0.9)

    def lose(light, dark):
        at = s.rng.exponential(1, light.shape) / -np.log1p(-np.maximum(lost, 1e-9))
        return np.minimum(light, at)

    s.on("light", lose)


@effect("scene", listed=False)
def extra_traps(s, k):
    """Atoms are held between the sites as well, now and then."""
    images = None
    share = s.rng.uniform(0.05, 0.1) * k

    def add(mean, dark):
        nonlocal images
        if dark:
            return mean
        if images is None:
            fine = np.roll(s.site_images(), int(round(0.5 * s.spacing * FINE)), (1, 2))
            images = s.binned(fine).reshape(s.sites, -1)
        here = (s.rng.random((len(mean), s.sites)) < share).astype(np.float32)
        return mean + s.electrons_per_atom * (here @ images).reshape(mean.shape)

    s.on("mean", add)


@effect("optics", listed=False)
def ghost_image(s, k):
    def ghost(mean, dark):
        return mean if dark else mean + 0.03 * k * np.maximum(0, mean - s.stray)[:, ::-1, ::-1]

    s.on("mean", ghost)


@effect("optics", listed=False)
def field_coma(s, k):
    x, y = s.field()
    s.wavefront[:, 3] += 0.035 * k * y
    s.wavefront[:, 4] += 0.035 * k * x


@effect("optics", listed=False)
def breathing_focus(s, k):
    """The focus changes from frame to frame: as a blur that does."""
    s.blur_frames(0.5 * k * np.abs(s.rng.normal(0, 1, s.count)))


@effect("optics", listed=False)
def distortion(s, k):
    x, y = s.field()
    r2 = x**2 + y**2
    s.x = s.x + 0.25 * k * x * (r2 - 0.7)
    s.y = s.y + 0.25 * k * y * (r2 - 0.7)


@effect("optics", listed=False)
def flickering_background(s, k):
    s.vary_stray_light(np.exp(0.15 * k * s.rng.normal(0, 1, s.count)))


@effect("optics", listed=False)
def leakage_spots(s, k):
    """Light of the traps on every site, atom or not."""
    images = None

    def leak(mean, dark):
        nonlocal images
        if dark:
            return mean
        if images is None:
            images = s.binned(s.site_images().sum(0))
        return mean + 0.01 * k * s.electrons_per_atom * images

    s.on("mean", leak)


@effect("optics", listed=False)
def breathing_magnification(s, k):
    """The array's image grows and shrinks from frame to frame."""
    state = {"n": 0}
    stretch = 1 + 0.006 * k * s.rng.normal(0, 1, s.count)

    def zoom(fine, dark):
        at = np.arange(fine.shape[0])
        from_ = (at - at.mean()) / stretch[state["n"] % s.count] + at.mean()
        state["n"] += 1
        low = np.clip(np.floor(from_).astype(int), 0, at.size - 2)
        part = from_ - low
        rows = fine[low] * (1 - part)[:, None] + fine[low + 1] * part[:, None]
        return rows[:, low] * (1 - part) + rows[:, low + 1] * part

    s.on("fine", zoom)


@effect("optics", listed=False)
def second_plane(s, k):
    """Atoms in a plane behind, far out of focus: one wide spot each."""
    y, x = np.mgrid[: s.size, : s.size]

    def behind(mean, dark):
        if dark:
            return mean
        for n in range(len(mean)):
            for _ in range(s.rng.poisson(3 * k)):
                u, v = s.rng.uniform(0, s.size, 2)
                spot = np.exp(-0.5 * ((x - u) ** 2 + (y - v) ** 2) / 5.0**2)
                mean[n] += s.electrons_per_atom * spot / (2 * np.pi * 5.0**2)
        return mean

    s.on("mean", behind)


@effect("optics", listed=False)
def moving_stray_light(s, k):
    """A gradient of stray light that turns around while the stack is taken."""
    x, y = s.pixels()
    turn = np.linspace(0, 2 * np.pi, s.count)[:, None, None]

    def turned(mean, dark):
        return mean if dark else mean + s.stray * min(0.9, 0.4 * k) * (x * np.cos(turn) + y * np.sin(turn))

    s.on("mean", turned)


@effect("optics", listed=False)
def dust(s, k):
    """Rings of shadow, out of focus, in all light."""
    x, y = s.pixels()
    shade = np.ones_like(x)
    for _ in range(6):
        u, v = s.rng.uniform(-0.9, 0.9, 2)
        shade -= 0.25 * k * np.exp(-(((np.hypot(x - u, y - v) - 0.12) / 0.05) ** 2))
    shade = np.maximum(0.1, shade)

    s.on("mean", lambda mean, dark: mean * shade)


@effect("optics", listed=False)
def stray_fringes(s, k):
    """Interference in the stray light, and in nothing else."""
    x, y = s.pixels()
    angle, period = s.rng.uniform(0, np.pi), s.rng.uniform(0.15, 0.5)
    s.background = s.background * (
        1 + min(0.95, 0.3 * k) * np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / period)
    )


@effect("optics", listed=False)
def rolling_flicker(s, k):
    """Light at twice the mains' frequency while row after row begins to expose."""
    rows = np.arange(s.size)[None, :, None] / s.rng.uniform(20, 60)
    phase = s.rng.random(s.count)[:, None, None]

    s.on("mean", lambda mean, dark: mean if dark else mean * (1 + 0.08 * k * np.sin(2 * np.pi * (rows + phase))))


@effect("optics", listed=False)
def focus_drift(s, k):
    """The images get wider from the first frame to the last."""
    s.blur_frames(0.6 * k * np.linspace(0, 1, s.count))


@effect("optics", listed=False)
def stray_light_drift(s, k):
    """A lamp that warms up: stray light alone, and slowly."""
    s.vary_stray_light(1 + 0.15 * k * np.linspace(-1, 1, s.count))


@effect("sensor", listed=False)
def exposure_jitter(s, k):
    """The shutter opens for longer or shorter: all light of a frame."""
    factor = np.maximum(0.1, 1 + 0.06 * k * s.rng.normal(0, 1, s.count))[:, None, None]

    s.on("mean", lambda mean, dark: mean if dark else mean * factor)


@effect("sensor", listed=False)
def torn_frames(s, k):
    """A frame ends with the rows of the one before."""

    def tear(counts, dark):
        for n in range(len(counts) - 1, 0, -1):
            if s.rng.random() < 0.04 * k:
                row = s.rng.integers(1, s.size)
                counts[n, row:] = counts[n - 1, row:]
        return counts

    s.on("counts", tear)


@effect("sensor", listed=False)
def odd_even_columns(s, k):
    """Two amplifiers take turns, and one has more gain."""
    gain = 1 + 0.03 * k * (np.arange(s.size) % 2 * 2 - 1)

    s.on("signal", lambda signal, dark: signal * gain)


@effect("sensor", listed=False)
def bad_columns(s, k):
    """A few columns that hardly collect, a few that leak."""
    chosen = s.rng.permutation(s.size)[: 2 + int(2 * k)]
    s.response[:, chosen[::2]] *= 1 - 0.4 * k / (1 + k)
    s.dark = s.dark + np.zeros((s.size, s.size))
    s.dark[:, chosen[1::2]] += 0.05 * k


@effect("sensor", listed=False)
def row_glitches(s, k):
    """Now and then a row is read at another level."""

    def glitch(counts, dark):
        some = s.rng.random((len(counts), s.size, 1)) < 0.004 * k
        return counts + some * 1.5 * s.read_noise * s.rng.normal(0, 1, some.shape)

    s.on("counts", glitch)


@effect("sensor", listed=False)
def afterglow(s, k):
    """Bright pixels glow for many frames."""

    def glow(mean, dark):
        if dark:
            return mean
        left, out = np.zeros_like(mean[0]), mean.copy()
        for n in range(len(mean)):
            out[n] += 0.004 * k * left
            left = 0.95 * left + mean[n]
        return out

    s.on("mean", glow)


@effect("sensor", listed=False)
def quadrant_bias(s, k):
    half = s.size // 2
    step = np.kron(s.rng.normal(0, 0.1 * k * s.read_noise, (2, 2)), np.ones((half, half)))

    s.on("counts", lambda counts, dark: counts + step)


@effect("sensor", listed=False)
def gain_drift(s, k):
    drift = 1 + 0.06 * k * np.linspace(-1, 1, s.count)

    s.on("signal", lambda signal, dark: signal if dark else signal * drift[:, None, None])


@effect("sensor", listed=False)
def column_noise(s, k):
    s.on("counts", lambda c, dark: c + s.rng.normal(0, 0.12 * k * s.read_noise, (len(c), 1, s.size)))


@effect("sensor", listed=False)
def amplifier_glow(s, k):
    x, y = s.pixels()
    glow = 0.12 * k * np.exp(-np.hypot(x + 1, y + 1) / 0.5)
    s.dark = s.dark + glow


@effect("sensor", listed=False)
def parallel_cti(s, k):
    share = 0.03 * k

    def trail(electrons, dark):
        moved = s.rng.binomial(electrons.astype(int), min(0.3, share))
        out = electrons - moved
        out[:, 1:] += moved[:, :-1]
        return out

    s.on("electrons", trail)


@effect("sensor", listed=False)
def missing_codes(s, k):
    every = {0.5: 16, 1: 8, 2: 4}[k]

    def miss(counts, dark):
        codes = np.rint(counts)
        return np.where(codes % every == 0, codes + 1, codes)

    s.on("counts", miss)


@effect("sensor", listed=False)
def heavy_read_noise(s, k):
    """Some reads are much noisier, on any pixel."""

    def noise(counts, dark):
        some = s.rng.random(counts.shape) < 0.004 * k
        return counts + some * s.rng.normal(0, 4 * s.read_noise, counts.shape)

    s.on("counts", noise)


@effect("sensor", listed=False)
def first_frames(s, k):
    s.on("counts", lambda c, dark: c + (0.5 * k * s.read_noise * np.exp(-np.arange(len(c)) / 3.0))[:, None, None])


@effect("sensor", listed=False)
def repeated_frames(s, k):
    def repeat(counts, dark):
        for n in range(1, len(counts)):
            if s.rng.random() < 0.015 * k:
                counts[n] = counts[n - 1]
        return counts

    s.on("counts", repeat)


@effect("sensor", listed=False)
def correlated_read_noise(s, k):
    def noise(counts, dark):
        extra = s.rng.normal(0, 0.35 * np.sqrt(k) * s.read_noise, counts.shape)
        extra[:, :, 1:] += 0.6 * extra[:, :, :-1]
        return counts + extra

    s.on("counts", noise)


@effect("sensor", listed=False)
def brighter_fatter(s, k):
    def spread(mean, dark):
        if dark:
            return mean
        flow = 6e-4 * k * mean * mean
        out = mean - flow
        for dr, dc in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            out += 0.25 * np.roll(flow, (dr, dc), (1, 2))
        return np.maximum(0, out)

    s.on("mean", spread)


@effect("sensor", "emccd", listed=False)
def em_gain_flicker(s, k):
    """The register's voltage is another one in every frame."""

    def flicker(signal, dark):
        return signal * np.maximum(0.1, 1 + 0.04 * k * s.rng.normal(0, 1, (len(signal), 1, 1)))

    s.on("signal", flicker)


@effect("sensor", listed=False)
def clipped_signal(s, k):
    """Charge beyond what a pixel or the register holds is lost."""

    def clip(signal, dark):
        if dark:
            return signal
        return np.minimum(signal, np.quantile(signal, 1 - 0.0015 * k))

    s.on("signal", clip)


@effect("sensor", listed=False)
def warming_sensor(s, k):
    """Dark charge that grows while frames are taken."""

    def warm(mean, dark):
        return mean + 0.03 * k * np.linspace(0, 1, len(mean))[:, None, None]

    s.on("mean", warm)


@effect("sensor", listed=False)
def noisier_half(s, k):
    """From the middle of the stack on the electronics are noisier."""

    def noise(counts, dark):
        later = np.arange(len(counts)) >= len(counts) // 2
        extra = s.read_noise * np.sqrt((1 + 0.1 * k) ** 2 - 1)
        return counts + later[:, None, None] * s.rng.normal(0, extra, counts.shape)

    s.on("counts", noise)


@effect("sensor", listed=False)
def dead_pixels(s, k):
    """Some pixels hardly respond."""
    s.response[s.rng.random(s.response.shape) < 0.006 * k] = 0.2


@effect("sensor", listed=False)
def lost_packets(s, k):
    """Some rows of a frame never arrive, and read zero."""

    def lose(counts, dark):
        for n in range(len(counts)):
            if s.rng.random() < 0.04 * k:
                row = s.rng.integers(0, s.size - 4)
                counts[n, row : row + 4] = 0
        return counts

    s.on("counts", lose)


# ---------------------------------------------------------------------------------------------------------------------
# In no catalogue either, and written without a look at how atomcam tells effects and stages apart.


def move_sites(s, offsets):
    """Every site's image by its own way in every frame: (2, frames, sites) in px, no more than 2 of them."""
    seen = None

    def see(light, dark):
        nonlocal seen
        seen = light.copy()
        return light

    def move(mean, dark):
        if dark:
            return mean
        images, light, off = s.site_images(), seen * s.brightness, np.clip(offsets, -2, 2) * FINE
        whole = np.rint(off)
        part, reach = off - whole, int(np.abs(whole).max()) + 1
        change = -(light.astype(np.float32) @ s.binned(images).reshape(s.sites, -1))

        def weight(axis, at):  # parabolic, as in `scattered`, but between parts of a pixel
            d, v = at - whole[axis], part[axis]
            return np.where(d == 0, 1 - v * v, np.where(np.abs(d) == 1, 0.5 * v * (v + d), 0))

        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                share = light * weight(0, dx) * weight(1, dy)
                if share.any():
                    pixels = s.binned(np.roll(images, (dy, dx), (1, 2)))
                    change += share.astype(np.float32) @ pixels.reshape(s.sites, -1)
        return np.maximum(0, mean + s.electrons_per_atom * change.reshape(mean.shape))

    s.on("light", see)
    s.on("mean", move)


@effect("scene", listed=False)
def patch_loss(s, k):
    """Now and then all atoms of a patch are gone at one moment, before the exposure or in it."""
    rows, columns = s.lattice

    def lose(light, dark):
        for n in np.flatnonzero(s.rng.random(s.count) < 0.1 * k):
            a = s.rng.integers(s.sites)
            near = np.hypot(rows - rows[a], columns - columns[a]) < 1.5
            light[n, near] = np.minimum(light[n, near], max(0, s.rng.uniform(-1, 1)))
        return light

    s.on("light", lose)


@effect("scene", listed=False)
def heating(s, k):
    """Atoms get hot in the light, some much sooner than others: fainter then, and their images wider."""
    hot = None

    def heat(light, dark):
        nonlocal hot
        rate = s.rng.exponential(0.3 * k, light.shape)
        hot = np.maximum(0, light + np.expm1(-rate * light) / rate)
        return light - 0.4 * hot

    def widen(mean, dark):
        if dark:
            return mean
        images = s.site_images()
        f = np.fft.fftfreq(images.shape[-1]) * FINE
        blur = np.exp(-2 * np.pi**2 * 0.8**2 * (f[:, None] ** 2 + f[: f.size // 2 + 1] ** 2))
        wider = np.fft.irfft2(np.fft.rfft2(images) * blur, images.shape[1:]) - images
        share = 0.6 * hot * s.brightness * s.electrons_per_atom
        return np.maximum(0, mean + (share @ s.binned(wider).reshape(s.sites, -1)).reshape(mean.shape))

    s.on("light", heat)
    s.on("mean", widen)


@effect("scene", listed=False)
def site_beats(s, k):
    """Tones of neighbouring traps beat: every site's brightness swings with a period of its own."""
    period, phase = s.rng.uniform(4, 60, s.sites), s.rng.uniform(0, 2 * np.pi, s.sites)
    swing = 1 + 0.1 * k * np.sin(2 * np.pi * np.arange(s.count)[:, None] / period + phase)

    s.on("light", lambda light, dark: light * swing)


@effect("scene", listed=False)
def addressed_line(s, k):
    """A beam along one row or column of traps is left on in some frames, and these atoms are brighter."""
    lines = s.lattice[int(s.rng.integers(2))]
    here = lines == s.rng.integers(lines.max() + 1)
    left_on = s.rng.random((s.count, 1)) < 0.2

    s.on("light", lambda light, dark: light * (1 + 0.2 * k * (left_on & here)))


@effect("scene", listed=False)
def rearranged_frames(s, k):
    """In some frames the atoms have been sorted towards the middle, but for those lost on the way."""
    x, y = s.field()
    order = np.argsort(np.maximum(np.abs(x), np.abs(y)))

    def sort(light, dark):
        for n in np.flatnonzero(s.rng.random(s.count) < 0.1 * k):
            atoms = s.rng.permutation(light[n, light[n] > 0])
            light[n] = 0
            light[n, order[: atoms.size]] = atoms * (s.rng.random(atoms.size) < 0.95)
        return light

    s.on("light", sort)


@effect("scene", listed=False)
def second_isotope(s, k):
    """Some atoms are of a fainter kind, more of them in some loads than in others."""

    def mix(light, dark):
        other = s.rng.random(light.shape) < np.minimum(0.8, 0.05 * k * s.rng.exponential(1, (s.count, 1)))
        return light * np.where(other, 0.55, 1)

    s.on("light", mix)


@effect("scene", listed=False)
def wandering_sites(s, k):
    """Traps move about slowly, each by itself."""
    memory = s.rng.uniform(20, 80)
    move_sites(s, 0.12 * k * np.array([[s.slow(s.count, memory) for _ in s.x] for _ in "xy"]).transpose(0, 2, 1))


@effect("scene", listed=False)
def crowding(s, k):
    """The more atoms there are in a frame, the fainter they all are."""

    def crowd(light, dark):
        atoms = np.sum(light > 0, 1, keepdims=True)
        return light * np.maximum(0.2, 1 - 0.25 * k * (atoms / max(1, atoms.mean()) - 1))

    s.on("light", crowd)


@effect("optics", listed=False)
def static_speckle(s, k):
    """Stray light of a laser off something rough, as fine as the objective lets it be."""
    side = s.size * FINE
    f = np.fft.fftfreq(side) * FINE
    pupil = np.hypot(f, f[:, None]) < s.aperture / s.wavelength * s.pixel / s.magnification
    field = np.fft.ifft2(pupil * (s.rng.normal(0, 1, (side, side)) + 1j * s.rng.normal(0, 1, (side, side))))
    speckle = s.binned(np.abs(field) ** 2)
    s.background = s.background * (1 + min(1, 0.2 * k) * (speckle / speckle.mean() - 1))


@effect("optics", listed=False)
def elongated_spots(s, k):
    """Every atom emits as its own axis has it, and its image is longer in some direction."""
    plain, angle = s.site_images, s.rng.uniform(0, np.pi, s.sites)
    ways = np.rint(2 * np.array([np.sin(angle), np.cos(angle)])).astype(int).T
    share = np.minimum(0.8, 0.3 * k * s.rng.random(s.sites))

    def longer():
        images = plain()
        for image, way, part in zip(images, ways, share):
            image += part * (0.5 * (np.roll(image, way, (0, 1)) + np.roll(image, -way, (0, 1))) - image)
        return images

    s.site_images = longer


@effect("optics", listed=False)
def moving_hair(s, k):
    """A hair on a window, out of focus, that creeps over the image and shades all light."""
    x, y = s.pixels()
    angle = s.rng.uniform(0, 2 * np.pi)
    across, along = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    at = s.rng.uniform(-0.4, 0.4) + 0.15 * s.slow(s.count, 60)[:, None, None]
    shade = 1 - min(0.9, 0.25 * k) * np.exp(-(((across + 0.2 * along**2 - at) / 0.07) ** 2))

    s.on("mean", lambda mean, dark: mean if dark else mean * shade)


@effect("optics", listed=False)
def field_astigmatism(s, k):
    """None in the middle, ever more to the corners, turned with the direction."""
    x, y = s.field()
    s.wavefront[:, 1] += 0.025 * k * 2 * x * y
    s.wavefront[:, 2] += 0.025 * k * (x**2 - y**2)


@effect("optics", listed=False)
def wedged_window(s, k):
    """Light that is reflected twice in a window: every spot once more, faint and close by."""
    plain, angle, far = s.site_images, s.rng.uniform(0, 2 * np.pi), s.rng.uniform(2, 4) * FINE
    way = (int(round(far * np.sin(angle))), int(round(far * np.cos(angle))))

    def double():
        images = plain()
        return images + np.float32(0.03 * k) * (np.roll(images, way, (1, 2)) - images)

    s.site_images = double


@effect("optics", listed=False)
def shutter_blade(s, k):
    """A sluggish blade stands in the light at one side, a little farther in or out in every frame."""
    x, y = s.pixels()
    angle = s.rng.uniform(0, 2 * np.pi)
    edge = 0.6 + 0.12 * s.rng.normal(0, 1, (s.count, 1, 1))
    shade = 1 - min(0.9, 0.3 * k) / (1 + np.exp((edge - x * np.cos(angle) - y * np.sin(angle)) / 0.07))

    s.on("mean", lambda mean, dark: mean if dark else mean * shade)


@effect("optics", listed=False)
def light_leak(s, k):
    """Room light that something glows with comes in from one edge, and fades along the stack."""
    x, y = s.pixels()
    depth = (1 + x, 1 - x, 1 + y, 1 - y)[int(s.rng.integers(4))]
    glow = s.stray * k * np.exp(-depth / 0.35) * np.exp(-3 * np.arange(s.count) / s.count)[:, None, None]

    s.on("mean", lambda mean, dark: mean if dark else mean + glow)


@effect("optics", listed=False)
def condensation(s, k):
    """A cold window mists over: a halo of every atom that grows from frame to frame."""
    f = np.fft.fftfreq(s.size)
    fx, fy = np.meshgrid(f, f)
    wide = 1 / (1 + (2 * np.pi * s.rng.uniform(4, 9)) ** 2 * (fx**2 + fy**2)) ** 1.5  # falls off exponentially
    share = min(0.5, 0.12 * k) * np.linspace(0, 1, s.count)

    def mist(mean, dark):
        if dark:
            return mean
        for n, part in enumerate(share):
            light = mean[n] - s.stray * s.background
            mean[n] += part * (np.fft.ifft2(np.fft.fft2(light) * wide).real - light)
        return np.maximum(0, mean)

    s.on("mean", mist)


@effect("sensor", listed=False)
def stuck_bit(s, k):
    """One bit of the converter is always read as one."""
    bit = {0.5: 1, 1: 2, 2: 4}[k]

    s.on("counts", lambda counts, dark: (np.rint(counts).astype(int) | bit).astype(float))


@effect("sensor", listed=False)
def two_taps(s, k):
    """Left and right half are read by amplifiers of their own."""
    gain = 1 + 0.025 * k * np.where(np.arange(s.size) < s.size // 2, 1, -1) * s.rng.choice([-1, 1])

    s.on("signal", lambda signal, dark: signal * gain)


@effect("sensor", listed=False)
def undershoot(s, k):
    """After a bright pixel the amplifier is low for the next few of the row."""

    def under(signal, dark):
        out = signal.copy()
        for step in (1, 2, 3):
            out[:, :, step:] -= 0.012 * k * 0.5 ** (step - 1) * signal[:, :, :-step]
        return out

    s.on("signal", under)


@effect("sensor", listed=False)
def row_clamp(s, k):
    """A row's level is held by its mean, and so rows with much light are low."""
    s.on("signal", lambda signal, dark: signal - 0.02 * k * signal.mean(2, keepdims=True))


@effect("sensor", "emccd", listed=False)
def blooming(s, k):
    """From bright pixels charge flows over to the rows above and below."""
    knee = 0.06 * s.electrons_per_atom

    def bloom(electrons, dark):
        for _ in range(3):
            over = s.rng.binomial(np.maximum(0, electrons - knee).astype(int), min(0.5, 0.06 * k))
            up = s.rng.binomial(over, 0.5)
            electrons = electrons - over
            electrons[:, :-1] += up[:, 1:]
            electrons[:, 1:] += (over - up)[:, :-1]
        return electrons

    s.on("electrons", bloom)


@effect("sensor", listed=False)
def ping_pong(s, k):
    """Two converters take turns from frame to frame."""

    def turns(values):
        return (np.arange(len(values)) % 2 * 2 - 1)[:, None, None]

    s.on("signal", lambda signal, dark: signal * (1 + 0.015 * k * turns(signal)))
    s.on("counts", lambda counts, dark: counts + 0.04 * k * s.read_noise * turns(counts))


@effect("sensor", "emccd", listed=False)
def spike_filter(s, k):
    """Firmware that takes a pixel far above all its neighbours for noise and puts their median there."""
    least = max(6 * s.read_noise, {0.5: 4, 1: 2.5, 2: 1.5}[k] * s.em_gain / s.electrons_per_count)
    steps = [(dr, dc) for dr in (-1, 0, 1) for dc in (-1, 0, 1) if dr or dc]

    def despike(counts, dark):
        for frame in counts:
            around = np.array([np.roll(frame, step, (0, 1)) for step in steps])
            some = frame - s.bias > np.maximum(least, 3 * (around.max(0) - s.bias))
            frame[some] = np.median(around[:, some], 0)
        return counts

    s.on("counts", despike)


@effect("sensor", listed=False)
def frame_averaging(s, k):
    """Firmware that leaves a little of the frame before in every frame, noise and all."""

    def average(counts, dark):
        for n in range(1, len(counts)):
            counts[n] += 0.03 * k * (counts[n - 1] - counts[n])
        return counts

    s.on("counts", average)


@effect("sensor", listed=False)
def sharpening(s, k):
    """Firmware that takes a little of the four neighbours from every pixel."""

    def sharpen(counts, dark):
        around = sum(np.roll(counts, step, (1, 2)) for step in ((0, 1), (0, -1), (1, 0), (-1, 0)))
        return counts + 0.012 * k * (4 * counts - around)

    s.on("counts", sharpen)


@effect("sensor", "qcmos", listed=False)
def column_gain(s, k):
    """Every column has its own amplifier."""
    gain = np.maximum(0.5, s.rng.normal(1, 0.03 * k, s.size))

    s.on("signal", lambda signal, dark: signal * gain)


@effect("sensor", listed=False)
def slipped_rows(s, k):
    """Now and then a row comes one pixel late."""

    def slip(counts, dark):
        some = s.rng.random(counts.shape[:2]) < 0.008 * k
        counts[some] = np.roll(counts[some], 1, 1)
        return counts

    s.on("counts", slip)


@effect("sensor", listed=False)
def black_clamp(s, k):
    """Nothing is stored below a level a little under the bias."""
    floor = s.bias - {0.5: 1.6, 1: 1.1, 2: 0.5}[k] * s.read_noise

    s.on("counts", lambda counts, dark: np.maximum(counts, floor))


@effect("sensor", "emccd", listed=False)
def cic_valley(s, k):
    """Clock-induced charge that is lowest in the middle rows."""
    s.dark = s.dark * (1 + 8 * k * np.linspace(-1, 1, s.size)[:, None] ** 2)


@effect("sensor", "emccd", listed=False)
def bias_pattern(s, k):
    """A bias that repeats every eight columns and starts high at the first ones."""
    columns = np.arange(s.size)
    pattern = s.rng.normal(0, 1, 8)[columns % 8] + 3 * np.exp(-columns / 5)

    s.on("counts", lambda counts, dark: counts + 0.04 * k * s.read_noise * pattern)


@effect("sensor", listed=False)
def next_frame(s, k):
    """The next exposure has begun while this frame is still read."""
    share = 0.02 * k

    def leak(electrons, dark):
        out = electrons.copy()
        out[:-1] += s.rng.poisson(share * electrons[1:])
        return out

    s.on("electrons", leak)


@effect("sensor", listed=False)
def defect_correction(s, k):
    """A camera that shows the mean of the two pixels beside it instead of one that it takes for bad."""
    bad = s.rng.random((s.size, s.size)) < 0.02 * k

    def correct(counts, dark):
        beside = 0.5 * (np.roll(counts, 1, 2) + np.roll(counts, -1, 2))
        return np.where(bad, beside, counts)

    s.on("counts", correct)


@effect("scene", listed=False)
def late_start(s, k):
    """Atoms start in a dark state and are pumped out of it after a while."""

    def wait(light, dark):
        return np.maximum(0, light - s.rng.exponential(0.1 * k, light.shape))

    s.on("light", wait)


@effect("scene", listed=False)
def standing_wave(s, k):
    """Retroreflected light: atoms sit on its fringes or between."""
    turns, direction, phase = s.rng.uniform(1.5, 4), s.rng.uniform(0, np.pi), s.rng.uniform(0, 2 * np.pi)
    x, y = s.field()
    along = x * np.cos(direction) + y * np.sin(direction)
    s.brightness *= 1 + 0.12 * k * np.cos(np.pi * turns * along + phase)


@effect("scene", listed=False)
def warm_atoms(s, k):
    """Atoms that light heats: at the end of the exposure they are farther from their traps."""

    def transfer(fx, fy):  # of normal laws of all variances up to the last
        last = 2 * np.pi**2 * (fx**2 + fy**2) * (0.5 * k) ** 2
        return np.where(last > 1e-9, -np.expm1(-last) / np.maximum(last, 1e-9), 1)

    s.blur = transfer


# ---------------------------------------------------------------------------------------------------------------------


def write_tiff(path, frames):
    """Little-endian TIFF, one strip a page, 16 bit."""
    count, rows, columns = frames.shape
    with open(path, "wb") as out:
        out.write(struct.pack("<2sHI", b"II", 42, 8))
        at = 8
        size = rows * columns * 2
        for n in range(count):
            entries = [
                (256, 4, columns), (257, 4, rows), (258, 3, 16), (259, 3, 1), (262, 3, 1),
                (273, 4, at + 2 + 9 * 12 + 4), (277, 3, 1), (278, 4, rows), (279, 4, size),
            ]
            after = at + 2 + 9 * 12 + 4 + size
            out.write(struct.pack("<H", len(entries)))
            for tag, kind, value in entries:
                out.write(struct.pack("<HHII", tag, kind, 1, value))
            out.write(struct.pack("<I", after if n + 1 < count else 0))
            out.write(frames[n].astype("<u2").tobytes())
            at = after


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-o", "--out", type=Path, help="folder to write")
    parser.add_argument("-n", "--stacks", type=int, default=10, help="how many (10)")
    parser.add_argument("--seed", type=int, default=1, help="of the series (1)")
    parser.add_argument("--frames", type=int, default=300, help="of a stack (300)")
    parser.add_argument("--darks", type=int, default=100, help="of a stack (100)")
    parser.add_argument("--size", type=int, default=96, help="rows and columns (96)")
    parser.add_argument("--effect", action="append", default=[], help="choose among these: NAME, NAME+NAME or none")
    parser.add_argument("--apodisation", type=float, default=0, help="dims the pupil's edge: power of the cosine (0)")
    parser.add_argument("--camera", choices=["emccd", "qcmos"], help="always this one")
    parser.add_argument("--strength", type=int, choices=[1, 2, 3], help="always this one (drawn)")
    parser.add_argument("--unlisted", action="store_true", help="only effects that are in no catalogue")
    parser.add_argument("--any-lab", action="store_true", help="other exposures, gains, optics and grids, too")
    parser.add_argument("--list", action="store_true", help="name the effects, make nothing")
    options = parser.parse_args()
    if options.list:
        for name, (stage, cameras, _) in EFFECTS.items():
            print(f"{name:30} {stage:7} {'' if name in MEMBER else 'unlisted':9} {' '.join(cameras)}")
        return
    if options.out is None:
        parser.error("-o: which folder to write")
    (options.out / "seals").mkdir(parents=True, exist_ok=True)
    pool = [name for name in EFFECTS if (name in MEMBER) != options.unlisted]
    for number in range(options.stacks):
        rng = np.random.default_rng([options.seed, number])
        folder = options.out / f"{number:04}"
        choice = options.effect[number % len(options.effect)] if options.effect else pool[int(rng.integers(len(pool)))]
        names = [] if choice == "none" else choice.split("+")
        for name in names:
            if name not in EFFECTS:
                parser.error(f"--effect {name}: --list names them")
        cameras = [c for c in ("emccd", "qcmos") if all(c in EFFECTS[name][1] for name in names)]
        camera = cameras[int(rng.integers(len(cameras)))]
        if options.camera in cameras:
            camera = options.camera
        other_labs = np.random.default_rng([options.seed, number, 1]) if options.any_lab else None
        stack = Stack(rng, camera, options.frames, options.darks, options.size, options.apodisation, other_labs)
        sealed = []
        for name in names:
            drawn = int(rng.integers(1, 4))
            strength = options.strength or drawn
            EFFECTS[name][2](stack, {1: 0.5, 2: 1, 3: 2}[strength])
            sealed.append({"name": name, "stage": EFFECTS[name][0], "grade": strength})
        if (folder / "lab.json").exists():
            continue
        folder.mkdir(exist_ok=True)
        write_tiff(folder / "frames.tif", stack.expose(dark=False))
        write_tiff(folder / "darks.tif", stack.expose(dark=True))
        truth = {
            key: float(getattr(stack, key))
            for key in ("electrons_per_atom", "stray", "filling", "survival", "bias", "em_gain", "electrons_per_count")
        }
        seal = {"effects": sealed, "camera": camera, "truth": truth}
        (options.out / "seals" / f"{number:04}.json").write_text(json.dumps(seal, indent=1))
        (folder / "lab.json").write_text(json.dumps(stack.notes(), indent=1))  # last: the stack is complete


if __name__ == "__main__":
    main()
