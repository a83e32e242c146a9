"""What a laboratory would come with: frames and darks of a small array, and notes that are tens of percent off."""

import atomcam

PLACES = [(10 + 11 * column, 10.3 + 11 * row) for row in range(4) for column in range(4)]

SETTINGS = {"exposure_s": 0.08, "em_gain": 300, "preamp_e_per_adu": 4.5, "bias_adu": 190, "read_noise_adu": 4,
            "pixel_um": 16, "magnification": 78.125, "cic_e": 0.002}
NOTES = {"camera": "iXon Ultra 897", "shape": [64, 64], "settings": SETTINGS,
         "site_grid": {"rows": 4, "cols": 4, "spacing_px": 10.9, "first_site_px": [9.5, 10]}}
#: Of the same frames, without a word about atoms.
NO_SITES = {name: value for name, value in NOTES.items() if name != "site_grid"}


def lab(**settings):
    made = atomcam.Lab({
        "camera.width_px": 64, "camera.height_px": 64, "camera.binning_x": 1, "camera.binning_y": 1,
        "optics.magnification": 78.125, "light.stray_light_photons_per_s": 3, "atoms.filling": 0.6,
        "effects.serial_cic": 0})
    made.sites = PLACES
    made.update(settings)
    return made


def darks_of(lab, frames):
    dark = lab.copy()
    dark["camera.shutter_open"] = False
    return dark.render(frames, 10000)[0]
