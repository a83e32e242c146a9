"""A small laboratory for the tests: 64 x 64 pixels with a few atoms."""

import atomcam


def lab(preset="ixon-ultra-897", **settings):
    made = atomcam.Lab.preset(preset)
    if preset == "orca-quest":
        # A smaller sensor: its maps are drawn anew for every lab.
        made.update({"sensor.columns": 512, "sensor.rows": 512})
    made.update(
        {
            "camera.binning_x": 1,
            "camera.binning_y": 1,
            "camera.offset_x_px": 128,
            "camera.offset_y_px": 192,
            "camera.width_px": 64,
            "camera.height_px": 64,
            "atoms.survival": 0.6,
        }
    )
    made.sites = [[140, 200.5], [150.25, 230], [170, 215], [185.5, 240], [160, 245]]
    made.update(settings)
    return made
