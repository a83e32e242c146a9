/* atomcam: a virtual camera for neutral-atom laboratories. The C interface.
 *
 * A lab is an opaque handle: atoms, optics, sensor, set-points and effects, from a preset or a lab file. Its
 * keys are those of the lab file ("camera.em_gain", "atoms.filling", "effects.row_noise"). Frames are
 * rendered straight into memory of the caller, with what is true of them. Frame n of a lab is always the
 * same, bit for bit.
 *
 * Every function that can fail returns ATOMCAM_OK or another status; atomcam_last_error() then says what was
 * wrong, where, and what is allowed. Texts are UTF-8 and end in a zero. Arrays are row-major, origin top
 * left, pixel centres at whole numbers.
 *
 * Threads: different labs may be used at the same time without care. One lab may be rendered and read by
 * several threads at the same time; a change takes effect for calls that begin after it. Free it when no
 * other call uses it.
 *
 * Stability: functions are only added, and structures only grow at their end; `size` says which members the
 * caller knows. Set it to sizeof the structure.
 */
#ifndef ATOMCAM_H
#define ATOMCAM_H

#include <stddef.h>
#include <stdint.h>

#define ATOMCAM_VERSION_MAJOR 0
#define ATOMCAM_VERSION_MINOR 1
#define ATOMCAM_VERSION_PATCH 0

#if defined(__GNUC__)
#define ATOMCAM_API __attribute__((visibility("default")))
#else
#define ATOMCAM_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* Status. */
enum {
  ATOMCAM_OK = 0,
  ATOMCAM_BAD_INPUT = 1, /* a file, key, value or argument; nothing was changed */
  ATOMCAM_TOO_SMALL = 2, /* the memory given is too small for the result */
  ATOMCAM_NO_MEMORY = 3,
  ATOMCAM_FAILED = 4 /* something else went wrong on the way */
};

typedef struct atomcam_lab atomcam_lab;

/* "0.1.0": of the library, which may be newer than this header. */
ATOMCAM_API const char* atomcam_version(void);
/* Of the last call on this thread that failed; valid until the next one. Empty: none yet. */
ATOMCAM_API const char* atomcam_last_error(void);
/* "bad input", ... for a status. */
ATOMCAM_API const char* atomcam_status_name(int status);

/* ---- Labs ---- */

/* A preset ("ixon-ultra-897", "orca-quest") or a lab file (.toml, .json). */
ATOMCAM_API int atomcam_lab_load(const char* file_or_preset, atomcam_lab** lab);
/* The text of a lab file; json: 0 for TOML, 1 for JSON. */
ATOMCAM_API int atomcam_lab_parse(const char* text, int json, atomcam_lab** lab);
ATOMCAM_API int atomcam_lab_copy(const atomcam_lab* lab, atomcam_lab** copy);
/* NULL is fine. */
ATOMCAM_API void atomcam_lab_free(atomcam_lab* lab);

/* By the file's extension, .toml (with comments) or .json. */
ATOMCAM_API int atomcam_lab_save(const atomcam_lab* lab, const char* file);
/* The lab as a file's text. `needed` (may be NULL) gets the bytes it takes, final zero included; with size 0,
 * text may be NULL, and the call only measures. */
ATOMCAM_API int atomcam_lab_text(const atomcam_lab* lab, int json, char* text, size_t size, size_t* needed);

/* ---- Keys ---- */

/* The value as on the command line: "300", "true", "3x". An effect by its strength ("effects.row_noise").
 * What keys decide together (region, binning, occupancy) is checked when frames are rendered, or by
 * atomcam_lab_check. */
ATOMCAM_API int atomcam_lab_set(atomcam_lab* lab, const char* key, const char* value);
ATOMCAM_API int atomcam_lab_set_number(atomcam_lab* lab, const char* key, double value);
ATOMCAM_API int atomcam_lab_get(const atomcam_lab* lab, const char* key, char* value, size_t size,
                                size_t* needed);
/* true and false are 1 and 0. */
ATOMCAM_API int atomcam_lab_get_number(const atomcam_lab* lab, const char* key, double* value);
ATOMCAM_API int atomcam_lab_check(const atomcam_lab* lab);

typedef struct atomcam_parameter {
  size_t size;         /* set to sizeof(atomcam_parameter) before the call */
  const char* key;     /* the unit stands in it */
  const char* unit;    /* "1" for a bare ratio, "" for a text */
  const char* meaning; /* one sentence */
  const char* allowed; /* "1 to 1000" or the list of choices */
  const char* source;  /* where the preset's value comes from; may be empty */
  double minimum, maximum, default_value;
  int is_text, is_integer, is_boolean, is_logarithmic;
  int is_live; /* may change while a camera runs */
} atomcam_parameter;

/* Keys 0 to count - 1 of this lab. The texts are valid until this thread asks for the next parameter. */
ATOMCAM_API int atomcam_lab_key_count(const atomcam_lab* lab, size_t* count);
ATOMCAM_API int atomcam_lab_key(const atomcam_lab* lab, size_t index, atomcam_parameter* parameter);

/* ---- Effects ---- */

typedef struct atomcam_effect {
  size_t size;         /* set to sizeof(atomcam_effect) before the call */
  const char* name;    /* "row_noise"; its keys are "effects.row_noise.<parameter>" */
  const char* stage;   /* scene, optics or sensor */
  const char* plane;   /* scene, photons, electrons, register or counts */
  const char* summary; /* one line */
  const char* reference;
  int on_emccd, on_qcmos; /* cameras it makes sense on */
  size_t parameters;      /* the first is the strength: at 0 the effect is absent */
  size_t observables;     /* what it moves */
} atomcam_effect;

/* Effects 0 to count - 1; their texts stay valid. */
ATOMCAM_API size_t atomcam_effect_count(void);
ATOMCAM_API int atomcam_effect_info(size_t index, atomcam_effect* effect);
/* The texts are valid until this thread asks for the next parameter. */
ATOMCAM_API int atomcam_effect_parameter(size_t index, size_t parameter, atomcam_parameter* info);
ATOMCAM_API int atomcam_effect_observable(size_t index, size_t observable, const char** name);

/* ---- Camera, sites, occupancy ---- */

/* Puts another lab's camera in front of these atoms: sensor, set-points and the effects behind the light. */
ATOMCAM_API int atomcam_lab_use_camera(atomcam_lab* lab, const atomcam_lab* camera);

ATOMCAM_API int atomcam_lab_site_count(const atomcam_lab* lab, size_t* count);
/* Arrays of `count` sites, in pixels of the whole sensor, x along columns; an array may be NULL. */
ATOMCAM_API int atomcam_lab_sites(const atomcam_lab* lab, size_t count, double* x_px, double* y_px,
                                  double* brightness);
/* Replaces grid or list; brightness may be NULL: 1 for all. Given occupancies are dropped. */
ATOMCAM_API int atomcam_lab_set_sites(atomcam_lab* lab, size_t count, const double* x_px, const double* y_px,
                                      const double* brightness);
/* [shot, site], 0 or 1: who is filled at the beginning of each shot, used in turn; shots = 0: drawn by
 * chance. */
ATOMCAM_API int atomcam_lab_set_occupancies(atomcam_lab* lab, size_t shots, size_t sites,
                                            const uint8_t* occupancies);

/* ---- Frames ---- */

/* Pixels of a frame: region over binning. */
ATOMCAM_API int atomcam_lab_frame_shape(const atomcam_lab* lab, size_t* rows, size_t* columns);

/* What is true of the frames that are rendered; a member that is NULL is not wanted. */
typedef struct atomcam_truth {
  size_t size; /* set to sizeof(atomcam_truth) */
  /* [frame, site] */
  uint8_t* present_at_start; /* 0 or 1, when the exposure begins */
  uint8_t* present_at_end;   /* 0 or 1, when it ends */
  double* x_px;              /* where the atom's image stands, in pixels of the whole sensor */
  double* y_px;
  double* loss_time_s;         /* since the exposure began; infinity: not lost */
  double* photons_emitted;     /* expected over its life in the exposure, into all directions */
  double* electrons_expected;  /* photo-electrons if the whole sensor plane were counted */
  int64_t* electrons_detected; /* photo-electrons in the region */
  /* [frame] */
  double* shift_x_px; /* of the whole image, already in x_px and y_px */
  double* shift_y_px;
  double* background_e; /* mean photo-electrons of stray light per physical pixel */
} atomcam_truth;

/* Frames first to first + frames - 1 into counts [frame, row, column], which has room for `length` numbers.
 * truth may be NULL. threads: 0 for all cores; the bits do not depend on it. */
ATOMCAM_API int atomcam_lab_render(const atomcam_lab* lab, uint64_t first, uint64_t frames, int threads,
                                   uint16_t* counts, size_t length, const atomcam_truth* truth);

/* Expected photo-electrons per pixel [row, column] of that frame: its atoms as drawn and its stray light. */
ATOMCAM_API int atomcam_lab_expected_electrons(const atomcam_lab* lab, uint64_t frame, float* image,
                                               size_t length);

/* The point-spread function as an image [row, column]: the share of an atom's light on each pixel, the atom's
 * image x_px, y_px beside the middle ((columns - 1) / 2, (rows - 1) / 2). Pixels are physical ones over
 * `oversampling` (1 or more); x_px and y_px count physical pixels. */
ATOMCAM_API int atomcam_lab_point_spread_function(const atomcam_lab* lab, size_t rows, size_t columns,
                                                  double x_px, double y_px, int oversampling, float* image,
                                                  size_t length);

#ifdef __cplusplus
}
#endif

#endif
