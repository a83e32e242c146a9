/* The C interface from a C99 program: what works, and what every function says to wrong input. */

#include <atomcam.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures = 0;

#define EXPECT(condition)                                                                     \
  do {                                                                                        \
    if (!(condition)) {                                                                       \
      ++failures;                                                                             \
      fprintf(stderr, "%s:%d: not so: %s (last error: %s)\n", __FILE__, __LINE__, #condition, \
              atomcam_last_error());                                                          \
    }                                                                                         \
  } while (0)

/* The call fails with this status, and its text has the word in it. */
#define EXPECT_FAILS(call, status, word)                                                            \
  do {                                                                                              \
    const int got = (call);                                                                         \
    if (got != (status) || !strstr(atomcam_last_error(), word)) {                                   \
      ++failures;                                                                                   \
      fprintf(stderr, "%s:%d: %s: %s, '%s'\n", __FILE__, __LINE__, #call, atomcam_status_name(got), \
              atomcam_last_error());                                                                \
    }                                                                                               \
  } while (0)

enum { FRAMES = 6, SIDE = 64, PIXELS = SIDE * SIDE, SITES = 4 };

static atomcam_lab* small_lab(void) {
  const double x[SITES] = {135.5, 150, 162.25, 181}, y[SITES] = {140, 170.5, 151, 139};
  atomcam_lab* lab = NULL;
  EXPECT(atomcam_lab_load("ixon-ultra-897", &lab) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set(lab, "camera.binning_x", "1") == ATOMCAM_OK);
  EXPECT(atomcam_lab_set(lab, "camera.binning_y", "1") == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_number(lab, "camera.offset_x_px", 128) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_number(lab, "camera.offset_y_px", 128) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_number(lab, "camera.width_px", SIDE) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_number(lab, "camera.height_px", SIDE) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_sites(lab, SITES, x, y, NULL) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set(lab, "atoms.survival", "0.5") == ATOMCAM_OK);
  EXPECT(atomcam_lab_check(lab) == ATOMCAM_OK);
  return lab;
}

static void frames_and_truth(void) {
  atomcam_lab *lab = small_lab(), *copy = NULL;
  static uint16_t counts[FRAMES * PIXELS], again[FRAMES * PIXELS];
  static uint8_t initial[FRAMES * SITES], final[FRAMES * SITES];
  static double loss[FRAMES * SITES], x[FRAMES * SITES], photons[FRAMES * SITES], background[FRAMES];
  static int64_t detected[FRAMES * SITES];
  atomcam_truth truth;
  size_t rows = 0, columns = 0;
  int n, filled = 0, lost = 0;
  memset(&truth, 0, sizeof truth);
  truth.size = sizeof truth;
  truth.present_at_start = initial;
  truth.present_at_end = final;
  truth.loss_time_s = loss;
  truth.x_px = x;
  truth.photons_emitted = photons;
  truth.electrons_detected = detected;
  truth.background_e = background;
  EXPECT(atomcam_lab_frame_shape(lab, &rows, &columns) == ATOMCAM_OK);
  EXPECT(rows == SIDE && columns == SIDE);
  EXPECT(atomcam_lab_render(lab, 3, FRAMES, 2, counts, FRAMES * PIXELS, &truth) == ATOMCAM_OK);
  for (n = 0; n < FRAMES * SITES; ++n) {
    EXPECT(initial[n] <= 1 && final[n] <= initial[n]);
    EXPECT((initial[n] && !final[n]) == !isinf(loss[n]));
    EXPECT((initial[n] != 0) == (photons[n] > 0));
    EXPECT(detected[n] >= 0 && (initial[n] || detected[n] == 0));
    EXPECT(x[n] > 128 && x[n] < 192);
    filled += initial[n];
    lost += initial[n] && !final[n];
  }
  EXPECT(filled > 0 && filled < FRAMES * SITES && lost > 0);
  EXPECT(background[0] > 0);

  /* Frame 5 alone, by a lab that went through its text. */
  {
    size_t needed = 0;
    char* text;
    EXPECT(atomcam_lab_text(lab, 0, NULL, 0, &needed) == ATOMCAM_OK);
    text = malloc(needed);
    EXPECT_FAILS(atomcam_lab_text(lab, 0, text, needed - 1, NULL), ATOMCAM_TOO_SMALL, "room for");
    EXPECT(atomcam_lab_text(lab, 0, text, needed, NULL) == ATOMCAM_OK);
    EXPECT(strlen(text) == needed - 1);
    EXPECT(atomcam_lab_parse(text, 0, &copy) == ATOMCAM_OK);
    free(text);
  }
  EXPECT(atomcam_lab_render(copy, 5, 1, 1, again, PIXELS, NULL) == ATOMCAM_OK);
  EXPECT(memcmp(again, counts + 2 * PIXELS, PIXELS * sizeof *again) == 0);
  atomcam_lab_free(copy);
  EXPECT(atomcam_lab_copy(lab, &copy) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_number(copy, "seed", 2) == ATOMCAM_OK);
  EXPECT(atomcam_lab_render(copy, 5, 1, 1, again, PIXELS, NULL) == ATOMCAM_OK);
  EXPECT(memcmp(again, counts + 2 * PIXELS, PIXELS * sizeof *again) != 0);

  /* A caller that knows only the first members: the others are left alone. */
  truth.size = offsetof(atomcam_truth, x_px);
  for (n = 0; n < FRAMES * SITES; ++n) x[n] = -1;
  EXPECT(atomcam_lab_render(lab, 3, FRAMES, 1, again, FRAMES * PIXELS, &truth) == ATOMCAM_OK);
  EXPECT(memcmp(again, counts, sizeof counts) == 0);
  EXPECT(x[0] == -1);

  /* Occupancy that is given. */
  {
    const uint8_t given[2 * SITES] = {1, 0, 0, 1, 0, 1, 1, 0}, wrong[SITES] = {0, 1, 2, 0};
    truth.size = sizeof truth;
    EXPECT(atomcam_lab_set_occupancies(lab, 2, SITES, given) == ATOMCAM_OK);
    EXPECT(atomcam_lab_render(lab, 0, FRAMES, 0, again, FRAMES * PIXELS, &truth) == ATOMCAM_OK);
    for (n = 0; n < FRAMES * SITES; ++n) EXPECT(initial[n] == given[n % (2 * SITES)]);
    EXPECT_FAILS(atomcam_lab_set_occupancies(lab, 1, SITES, wrong), ATOMCAM_BAD_INPUT, "allowed 0, 1");
    EXPECT_FAILS(atomcam_lab_set_occupancies(lab, 1, SITES - 1, given), ATOMCAM_BAD_INPUT, "the lab has 4");
  }
  EXPECT_FAILS(atomcam_lab_render(lab, 0, FRAMES, 0, again, FRAMES * PIXELS - 1, NULL), ATOMCAM_TOO_SMALL,
               "counts");
  EXPECT_FAILS(atomcam_lab_render(lab, 0, ~(uint64_t)0, 0, again, FRAMES * PIXELS, NULL), ATOMCAM_TOO_SMALL,
               "counts");
  EXPECT_FAILS(atomcam_lab_render(lab, 0, 1, -1, again, PIXELS, NULL), ATOMCAM_BAD_INPUT, "threads");
  atomcam_lab_free(lab);
  atomcam_lab_free(copy);
}

static void keys(void) {
  atomcam_lab* lab = small_lab();
  char text[64];
  double number = 0;
  size_t count = 0, i, needed = 0, found = 0;
  EXPECT(atomcam_lab_set(lab, "camera.em_gain", "250.5") == ATOMCAM_OK);
  EXPECT(atomcam_lab_get(lab, "camera.em_gain", text, sizeof text, &needed) == ATOMCAM_OK);
  EXPECT(strcmp(text, "250.5") == 0 && needed == 6);
  EXPECT(atomcam_lab_get_number(lab, "camera.shutter_open", &number) == ATOMCAM_OK && number == 1);
  EXPECT(atomcam_lab_set(lab, "camera.preamp", "1x") == ATOMCAM_OK);
  EXPECT_FAILS(atomcam_lab_get_number(lab, "camera.preamp", &number), ATOMCAM_BAD_INPUT, "text");
  EXPECT_FAILS(atomcam_lab_set(lab, "camera.em_gain", "5000"), ATOMCAM_BAD_INPUT, "1 to 1000");
  EXPECT_FAILS(atomcam_lab_set_number(lab, "camera.em_gain", NAN), ATOMCAM_BAD_INPUT, "camera.em_gain");
  EXPECT_FAILS(atomcam_lab_set(lab, "camera.em_gian", "300"), ATOMCAM_BAD_INPUT, "'camera.em_gain'");
  EXPECT_FAILS(atomcam_lab_set(lab, "camera.scan", "standard"), ATOMCAM_BAD_INPUT, "EMCCD");
  EXPECT(atomcam_lab_get_number(lab, "camera.em_gain", &number) == ATOMCAM_OK && number == 250.5);
  EXPECT(atomcam_lab_key_count(lab, &count) == ATOMCAM_OK && count > 50);
  for (i = 0; i < count; ++i) {
    atomcam_parameter key;
    key.size = sizeof key;
    EXPECT(atomcam_lab_key(lab, i, &key) == ATOMCAM_OK);
    EXPECT(key.key[0] && key.meaning[0] && key.allowed[0] && key.size == sizeof key);
    EXPECT(atomcam_lab_get(lab, key.key, NULL, 0, &needed) == ATOMCAM_OK && needed >= 1);
    if (strcmp(key.key, "camera.em_gain") == 0) {
      ++found;
      EXPECT(key.minimum == 1 && key.maximum == 1000 && !key.is_text && !key.is_integer);
    }
  }
  EXPECT(found == 1);
  {
    atomcam_parameter key;
    key.size = sizeof key;
    EXPECT_FAILS(atomcam_lab_key(lab, count, &key), ATOMCAM_BAD_INPUT, "index");
  }
  EXPECT(atomcam_lab_set(lab, "camera.width_px", "500") == ATOMCAM_OK);
  EXPECT_FAILS(atomcam_lab_check(lab), ATOMCAM_BAD_INPUT, "region");
  atomcam_lab_free(lab);
}

static void effects(void) {
  size_t i, j;
  EXPECT(atomcam_effect_count() > 20);
  for (i = 0; i < atomcam_effect_count(); ++i) {
    atomcam_effect effect;
    effect.size = sizeof effect;
    EXPECT(atomcam_effect_info(i, &effect) == ATOMCAM_OK);
    EXPECT(effect.name[0] && effect.stage[0] && effect.plane[0] && effect.summary[0] && effect.reference[0]);
    EXPECT(effect.on_emccd || effect.on_qcmos);
    EXPECT(effect.parameters >= 1 && effect.observables >= 1);
    for (j = 0; j < effect.parameters; ++j) {
      atomcam_parameter parameter;
      parameter.size = sizeof parameter;
      EXPECT(atomcam_effect_parameter(i, j, &parameter) == ATOMCAM_OK);
      EXPECT(parameter.minimum < parameter.maximum && parameter.unit[0]);
    }
    for (j = 0; j < effect.observables; ++j) {
      const char* name = NULL;
      EXPECT(atomcam_effect_observable(i, j, &name) == ATOMCAM_OK && name && name[0]);
    }
  }
}

static void pictures(void) {
  atomcam_lab *lab = small_lab(), *orca = NULL;
  static float image[SIDE * SIDE];
  double sum = 0, text_is = 0;
  int i;
  EXPECT(atomcam_lab_point_spread_function(lab, 33, 33, 0, 0, 1, image, SIDE * SIDE) == ATOMCAM_OK);
  for (i = 0; i < 33 * 33; ++i) sum += image[i];
  EXPECT(sum > 0.5 && sum <= 1.0001);
  EXPECT_FAILS(atomcam_lab_point_spread_function(lab, 33, 33, 0, 0, 0, image, SIDE * SIDE), ATOMCAM_BAD_INPUT,
               "oversampling");
  EXPECT_FAILS(atomcam_lab_point_spread_function(lab, 33, 33, 0, 0, 1, image, 1000), ATOMCAM_TOO_SMALL,
               "1089");
  EXPECT(atomcam_lab_expected_electrons(lab, 0, image, SIDE * SIDE) == ATOMCAM_OK);
  EXPECT_FAILS(atomcam_lab_expected_electrons(lab, 0, image, 5), ATOMCAM_TOO_SMALL, "image");
  EXPECT(atomcam_lab_load("orca-quest", &orca) == ATOMCAM_OK);
  EXPECT(atomcam_lab_set_number(orca, "sensor.dark_gamma_shape", 2) == ATOMCAM_OK);
  EXPECT(atomcam_lab_use_camera(lab, orca) == ATOMCAM_OK);
  EXPECT(atomcam_lab_get_number(lab, "sensor.dark_gamma_shape", &text_is) == ATOMCAM_OK && text_is == 2);
  EXPECT(atomcam_lab_get_number(lab, "atoms.survival", &text_is) == ATOMCAM_OK && text_is == 0.5);
  atomcam_lab_free(orca);
  atomcam_lab_free(lab);
}

static void files(void) {
  atomcam_lab *lab = small_lab(), *read = NULL;
  const char* file = "capi_test_lab.toml";
  size_t count = 0;
  EXPECT(atomcam_lab_save(lab, file) == ATOMCAM_OK);
  EXPECT(atomcam_lab_load(file, &read) == ATOMCAM_OK);
  EXPECT(atomcam_lab_site_count(read, &count) == ATOMCAM_OK && count == SITES);
  atomcam_lab_free(read);
  remove(file);
  EXPECT_FAILS(atomcam_lab_load(file, &read), ATOMCAM_BAD_INPUT, file);
  EXPECT(read == NULL);
  EXPECT_FAILS(atomcam_lab_load("ixon", &read), ATOMCAM_BAD_INPUT, "ixon-ultra-897");
  EXPECT_FAILS(atomcam_lab_parse("[camera]\nem_gian = 3\n", 0, &read), ATOMCAM_BAD_INPUT, "em_gain");
  EXPECT_FAILS(atomcam_lab_save(lab, "lab.xml"), ATOMCAM_BAD_INPUT, ".toml");
  atomcam_lab_free(lab);
}

static void null_pointers(void) {
  atomcam_lab* lab = small_lab();
  double number;
  uint16_t pixel;
  atomcam_lab *none = lab;
  EXPECT_FAILS(atomcam_lab_load(NULL, &none), ATOMCAM_BAD_INPUT, "file_or_preset");
  EXPECT(none == NULL);
  EXPECT_FAILS(atomcam_lab_load("orca-quest", NULL), ATOMCAM_BAD_INPUT, "lab: NULL");
  EXPECT_FAILS(atomcam_lab_set(NULL, "seed", "1"), ATOMCAM_BAD_INPUT, "lab: NULL");
  EXPECT_FAILS(atomcam_lab_set(lab, NULL, "1"), ATOMCAM_BAD_INPUT, "key: NULL");
  EXPECT_FAILS(atomcam_lab_set(lab, "seed", NULL), ATOMCAM_BAD_INPUT, "value: NULL");
  EXPECT_FAILS(atomcam_lab_get_number(NULL, "seed", &number), ATOMCAM_BAD_INPUT, "lab: NULL");
  EXPECT_FAILS(atomcam_lab_render(NULL, 0, 1, 1, &pixel, 1, NULL), ATOMCAM_BAD_INPUT, "lab: NULL");
  EXPECT_FAILS(atomcam_lab_render(lab, 0, 1, 1, NULL, 1, NULL), ATOMCAM_BAD_INPUT, "counts: NULL");
  EXPECT_FAILS(atomcam_effect_info(0, NULL), ATOMCAM_BAD_INPUT, "effect: NULL");
  EXPECT_FAILS(atomcam_lab_text(lab, 0, NULL, 0, NULL), ATOMCAM_BAD_INPUT, "needed: NULL");
  atomcam_lab_free(lab);
  atomcam_lab_free(NULL);
}

/* Errors are the thread's own. */
static void* other_thread(void* argument) {
  (void)argument;
  if (atomcam_last_error()[0]) return (void*)"an error of another thread is seen";
  atomcam_lab_load("nowhere.toml", &(atomcam_lab*){NULL});
  return strstr(atomcam_last_error(), "nowhere.toml") ? NULL : (void*)"the thread's own error is not seen";
}

static void threads(void) {
  pthread_t thread;
  void* problem = NULL;
  atomcam_lab* lab = NULL;
  EXPECT(atomcam_lab_load("elsewhere.toml", &lab) == ATOMCAM_BAD_INPUT);
  pthread_create(&thread, NULL, other_thread, NULL);
  pthread_join(thread, &problem);
  if (problem) fprintf(stderr, "%s\n", (const char*)problem);
  EXPECT(problem == NULL);
  EXPECT(strstr(atomcam_last_error(), "elsewhere.toml") != NULL);
}

/* Programs that were compiled against version 0 know these places. */
static void places_of_members(void) {
  if (sizeof(void*) != 8) return;
  EXPECT(offsetof(atomcam_parameter, key) == 8 && offsetof(atomcam_parameter, source) == 40);
  EXPECT(offsetof(atomcam_parameter, minimum) == 48 && offsetof(atomcam_parameter, default_value) == 64);
  EXPECT(offsetof(atomcam_parameter, is_text) == 72 && offsetof(atomcam_parameter, is_live) == 88);
  EXPECT(offsetof(atomcam_effect, name) == 8 && offsetof(atomcam_effect, reference) == 40);
  EXPECT(offsetof(atomcam_effect, on_emccd) == 48 && offsetof(atomcam_effect, observables) == 64);
  EXPECT(offsetof(atomcam_truth, present_at_start) == 8 && offsetof(atomcam_truth, electrons_detected) == 64);
  EXPECT(offsetof(atomcam_truth, shift_x_px) == 72 && offsetof(atomcam_truth, background_e) == 88);
  EXPECT(ATOMCAM_OK == 0 && ATOMCAM_BAD_INPUT == 1 && ATOMCAM_TOO_SMALL == 2 && ATOMCAM_NO_MEMORY == 3);
  EXPECT(ATOMCAM_FAILED == 4);
}

int main(void) {
  char version[32];
  sprintf(version, "%d.%d.%d", ATOMCAM_VERSION_MAJOR, ATOMCAM_VERSION_MINOR, ATOMCAM_VERSION_PATCH);
  EXPECT(strcmp(atomcam_version(), version) == 0);
  EXPECT(strcmp(atomcam_last_error(), "") == 0);
  places_of_members();
  frames_and_truth();
  keys();
  effects();
  pictures();
  files();
  null_pointers();
  threads();
  if (failures) fprintf(stderr, "%d failures\n", failures);
  return failures != 0;
}
