/* Renders frames of a lab with their truth, and compares what a threshold on the light about each site says
 * with what is true.
 *
 *     cc -std=c99 frames.c $(pkg-config --cflags --libs atomcam) -o frames
 *     ./frames [LAB]          a preset or a lab file
 */

#include <atomcam.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void check(int status) {
  if (status == ATOMCAM_OK) return;
  fprintf(stderr, "frames: %s: %s\n", atomcam_status_name(status), atomcam_last_error());
  exit(status == ATOMCAM_BAD_INPUT ? 2 : 1);
}

static int compare(const void* a, const void* b) {
  const double left = *(const double*)a, right = *(const double*)b;
  return (left > right) - (left < right);
}

int main(int argc, char** argv) {
  enum { frames = 20 };
  atomcam_lab* lab;
  size_t rows, columns, sites, s;
  double binning_x, binning_y, offset_x, offset_y, bias;
  long right = 0;
  int n;

  check(atomcam_lab_load(argc > 1 ? argv[1] : "ixon-ultra-897", &lab));
  check(atomcam_lab_set(lab, "atoms.filling", "0.5"));
  check(atomcam_lab_set_number(lab, "camera.exposure_s", 0.05));
  check(atomcam_lab_frame_shape(lab, &rows, &columns));
  check(atomcam_lab_site_count(lab, &sites));
  check(atomcam_lab_get_number(lab, "camera.binning_x", &binning_x));
  check(atomcam_lab_get_number(lab, "camera.binning_y", &binning_y));
  check(atomcam_lab_get_number(lab, "camera.offset_x_px", &offset_x));
  check(atomcam_lab_get_number(lab, "camera.offset_y_px", &offset_y));
  check(atomcam_lab_get_number(lab, "camera.bias_counts", &bias));

  const size_t pixels = rows * columns;
  uint16_t* counts = malloc(frames * pixels * sizeof *counts);
  uint8_t* initial = malloc(frames * sites);
  double *x = malloc(frames * sites * sizeof *x), *y = malloc(frames * sites * sizeof *y);
  atomcam_truth truth;
  memset(&truth, 0, sizeof truth);
  truth.size = sizeof truth;
  truth.present_at_start = initial;
  truth.x_px = x;
  truth.y_px = y;
  check(atomcam_lab_render(lab, 0, frames, 0, counts, frames * pixels, &truth));

  /* The sum of 3 x 3 pixels about each site. */
  double *sums = malloc(frames * sites * sizeof *sums), *sorted = malloc(frames * sites * sizeof *sorted);
  for (n = 0; n < frames; ++n) {
    for (s = 0; s < sites; ++s) {
      /* Positions are in pixels of the sensor: region and binning lie between them and the frame. */
      const size_t at = n * sites + s;
      const long column = (long)((x[at] + 0.5 - offset_x) / binning_x);
      const long row = (long)((y[at] + 0.5 - offset_y) / binning_y);
      long dx, dy;
      sums[at] = 0;
      for (dy = row - 1; dy <= row + 1; ++dy)
        for (dx = column - 1; dx <= column + 1; ++dx)
          if (dy >= 0 && dx >= 0 && dy < (long)rows && dx < (long)columns)
            sums[at] += counts[n * pixels + (size_t)dy * columns + (size_t)dx] - bias;
      sorted[at] = sums[at];
    }
  }
  /* Half of the sites are filled: a threshold half way between the dark and the bright quarter. */
  const size_t all = frames * sites;
  qsort(sorted, all, sizeof *sorted, compare);
  const double threshold = (sorted[all / 4] + sorted[3 * all / 4]) / 2;
  for (s = 0; s < all; ++s) right += (sums[s] > threshold) == (initial[s] != 0);

  printf(
      "atomcam %s: %d frames of %lu x %lu pixels, %lu sites; a simple threshold is right for %.1f %% of "
      "them\n",
      atomcam_version(), (int)frames, (unsigned long)columns, (unsigned long)rows, (unsigned long)sites,
      100.0 * (double)right / (double)all);
  free(counts);
  free(sums);
  free(sorted);
  free(initial);
  free(x);
  free(y);
  atomcam_lab_free(lab);
  return 0;
}
