#pragma once
// Names of what can be measured in a stack of frames. Effects declare which of them they move.

#include <array>
#include <string_view>

namespace atomcam {

inline constexpr std::array<std::string_view, 24> observables = {
    "pixel_histogram",         // of dark pixels: read noise, tails
    "mean_map",                // temporal mean per pixel
    "variance_map",            // temporal variance per pixel
    "kurtosis_map",            // temporal kurtosis and bimodality per pixel
    "lag_correlation",         // of a pixel with itself one frame later
    "row_means",               // temporal variance of row means
    "column_means",            // static or temporal variance of column means
    "row_spectrum",            // of values along readout time
    "horizontal_correlation",  // of neighbours along a row
    "vertical_correlation",    // of neighbours along a column
    "trailing_charge",         // behind bright pixels along the row
    "column_smear",            // above and below bright pixels
    "frame_means",             // series of frame means
    "site_brightness",         // mean per site
    "site_histogram",          // of region sums: peaks, between them
    "site_correlation",        // of the brightness of different sites
    "neighbour_exchange",      // light that moves between neighbouring sites
    "point_spread_width",      // mean width of a site's image
    "point_spread_field",      // width or shape against field position
    "point_spread_halo",       // light far from the site
    "centroid_series",         // position of the array from frame to frame
    "mean_variance_curve",     // photon transfer
    "bright_clusters",         // isolated bright pixels or tracks
    "brightness_series"};      // mean brightness of occupied sites along the stack

}  // namespace atomcam
