#pragma once
// Where the gap lies, as markup.

#include <string>

#include "diagnosis/diagnosis.hpp"

namespace atomcam::report {

/// Rows: stage and observable; columns: axes; colour: the largest deviation of each.
std::string where_matrix(const Diagnosis& diagnosis);

/// The strongest differences, one by one.
std::string where_list(const Diagnosis& diagnosis, std::size_t most);

}  // namespace atomcam::report
