#include <cstring>

#include <fmt/format.h>

#include "base/error.hpp"
#include "capi/lab_handle.hpp"
#include "capi/status.hpp"
#include "effects/effect.hpp"

using namespace atomcam;

namespace {

/// The texts of the parameter that this thread asked for last.
thread_local KeyInfo latest;

void hand_out(KeyInfo info, atomcam_parameter* parameter) {
  latest = std::move(info);
  copy_known(parameter, {.size = 0,
                         .key = latest.key.c_str(),
                         .unit = latest.unit.c_str(),
                         .meaning = latest.meaning.c_str(),
                         .allowed = latest.allowed.c_str(),
                         .source = latest.source.c_str(),
                         .minimum = latest.minimum,
                         .maximum = latest.maximum,
                         .default_value = latest.default_value,
                         .is_text = latest.text,
                         .is_integer = latest.integer,
                         .is_boolean = latest.boolean,
                         .is_logarithmic = latest.logarithmic,
                         .is_live = latest.live});
}

template <class Range>
const auto& element(const Range& range, std::size_t index, std::string_view name) {
  if (index >= range.size()) throw Error(name, fmt::format("{}; allowed less than {}", index, range.size()));
  return range[index];
}

struct AsNumber {
  std::string_view key;
  double operator()(bool value) const { return value ? 1 : 0; }
  double operator()(std::int64_t value) const { return static_cast<double>(value); }
  double operator()(double value) const { return value; }
  double operator()(const std::string&) const { throw Error(key, "holds a text, not a number"); }
};

}  // namespace

int atomcam_lab_set(atomcam_lab* lab, const char* key, const char* value) {
  return guarded([&] {
    require(lab, "lab");
    require(key, "key");
    require(value, "value");
    lab->bench.set_text(key, value);
  });
}

int atomcam_lab_set_number(atomcam_lab* lab, const char* key, double value) {
  return guarded([&] {
    require(lab, "lab");
    require(key, "key");
    lab->bench.set(key, value);
  });
}

int atomcam_lab_get(const atomcam_lab* lab, const char* key, char* value, size_t size, size_t* needed) {
  return guarded([&] {
    require(lab, "lab");
    require(key, "key");
    copy_text(text_of(lab->bench.get(key)), value, size, needed);
  });
}

int atomcam_lab_get_number(const atomcam_lab* lab, const char* key, double* value) {
  return guarded([&] {
    require(lab, "lab");
    require(key, "key");
    require(value, "value");
    *value = std::visit(AsNumber{key}, lab->bench.get(key));
  });
}

int atomcam_lab_check(const atomcam_lab* lab) {
  return guarded([&] {
    require(lab, "lab");
    check_lab(lab->bench.lab(), "lab");
  });
}

int atomcam_lab_key_count(const atomcam_lab* lab, size_t* count) {
  return guarded([&] {
    require(lab, "lab");
    require(count, "count");
    *count = list_keys(lab->bench.lab()).size();
  });
}

int atomcam_lab_key(const atomcam_lab* lab, size_t index, atomcam_parameter* parameter) {
  return guarded([&] {
    require(lab, "lab");
    require(parameter, "parameter");
    hand_out(element(list_keys(lab->bench.lab()), index, "index"), parameter);
  });
}

size_t atomcam_effect_count(void) {
  return effect_catalogue().size();
}

int atomcam_effect_info(size_t index, atomcam_effect* effect) {
  return guarded([&] {
    require(effect, "effect");
    const EffectDeclaration& found = element(effect_catalogue(), index, "index");
    copy_known(effect, {.size = 0,
                        .name = found.name.c_str(),
                        .stage = found.stage().data(),
                        .plane = plane_name(found.plane).data(),
                        .summary = found.summary.c_str(),
                        .reference = found.reference.c_str(),
                        .on_emccd = found.emccd,
                        .on_qcmos = found.qcmos,
                        .parameters = found.parameters.size(),
                        .observables = found.observables.size()});
  });
}

int atomcam_effect_parameter(size_t index, size_t parameter, atomcam_parameter* info) {
  return guarded([&] {
    require(info, "info");
    const EffectDeclaration& found = element(effect_catalogue(), index, "index");
    hand_out(describe(element(found.parameters, parameter, "parameter")), info);
  });
}

int atomcam_effect_observable(size_t index, size_t observable, const char** name) {
  return guarded([&] {
    require(name, "name");
    const EffectDeclaration& found = element(effect_catalogue(), index, "index");
    *name = element(found.observables, observable, "observable").c_str();
  });
}
