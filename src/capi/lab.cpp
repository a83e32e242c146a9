#include "capi/lab_handle.hpp"

#include <fmt/format.h>

#include "base/error.hpp"
#include "capi/status.hpp"

using namespace atomcam;

namespace {

void make(Lab lab, atomcam_lab** out) {
  *out = new atomcam_lab{Workbench(std::move(lab))};
}

}  // namespace

int atomcam_lab_load(const char* file_or_preset, atomcam_lab** lab) {
  return guarded([&] {
    require(lab, "lab");
    *lab = nullptr;
    require(file_or_preset, "file_or_preset");
    make(load_lab(file_or_preset), lab);
  });
}

int atomcam_lab_parse(const char* text, int json, atomcam_lab** lab) {
  return guarded([&] {
    require(lab, "lab");
    *lab = nullptr;
    require(text, "text");
    make(parse_lab(text, "text", json != 0), lab);
  });
}

int atomcam_lab_copy(const atomcam_lab* lab, atomcam_lab** copy) {
  return guarded([&] {
    require(copy, "copy");
    *copy = nullptr;
    require(lab, "lab");
    make(lab->bench.lab(), copy);
  });
}

void atomcam_lab_free(atomcam_lab* lab) {
  delete lab;
}

int atomcam_lab_save(const atomcam_lab* lab, const char* file) {
  return guarded([&] {
    require(lab, "lab");
    require(file, "file");
    save_lab(lab->bench.lab(), file);
  });
}

int atomcam_lab_text(const atomcam_lab* lab, int json, char* text, size_t size, size_t* needed) {
  return guarded([&] {
    require(lab, "lab");
    const Lab copy = lab->bench.lab();
    copy_text(json ? write_lab_json(copy) : write_lab(copy), text, size, needed);
  });
}

int atomcam_lab_use_camera(atomcam_lab* lab, const atomcam_lab* camera) {
  return guarded([&] {
    require(lab, "lab");
    require(camera, "camera");
    const Lab other = camera->bench.lab();
    lab->bench.change([&](Lab& changed) { changed = with_camera_of(changed, other); });
  });
}

int atomcam_lab_site_count(const atomcam_lab* lab, size_t* count) {
  return guarded([&] {
    require(lab, "lab");
    require(count, "count");
    *count = lab->bench.lab().scene.sites.size();
  });
}

int atomcam_lab_sites(const atomcam_lab* lab, size_t count, double* x_px, double* y_px, double* brightness) {
  return guarded([&] {
    require(lab, "lab");
    const std::vector<Site> sites = lab->bench.lab().scene.sites;
    require_room(count, sites.size(), "sites");
    for (std::size_t i = 0; i < sites.size(); ++i) {
      if (x_px) x_px[i] = sites[i].x_px;
      if (y_px) y_px[i] = sites[i].y_px;
      if (brightness) brightness[i] = sites[i].brightness;
    }
  });
}

int atomcam_lab_set_sites(atomcam_lab* lab, size_t count, const double* x_px, const double* y_px,
                          const double* brightness) {
  return guarded([&] {
    require(lab, "lab");
    require(x_px, "x_px");
    require(y_px, "y_px");
    std::vector<Site> sites(count);
    for (std::size_t i = 0; i < count; ++i) sites[i] = {x_px[i], y_px[i], brightness ? brightness[i] : 1};
    lab->bench.change([&](Lab& changed) { set_sites(changed, std::move(sites)); });
  });
}

int atomcam_lab_set_occupancies(atomcam_lab* lab, size_t shots, size_t sites, const uint8_t* occupancies) {
  return guarded([&] {
    require(lab, "lab");
    if (shots > 0) require(occupancies, "occupancies");
    std::vector<Occupancy> given(shots);
    for (std::size_t shot = 0; shot < shots; ++shot)
      given[shot].assign(occupancies + shot * sites, occupancies + (shot + 1) * sites);
    lab->bench.change([&](Lab& changed) { set_occupancies(changed, std::move(given)); });
  });
}
