#pragma once
// Self-contained pages: what every report shares. They are HTML that is XML too, without any reference to
// something outside.

#include <string>
#include <string_view>

namespace atomcam::report {

/// Text between tags or in an attribute; characters that XML does not know become spaces.
std::string escaped(std::string_view text);

/// 4 figures, without an exponent where that is readable.
std::string short_number(double value, int figures = 4);

/// "1.234 ± 0.012": as many digits as the error has, and one more.
std::string with_error(double value, double error);

/// A whole page; `body` is markup.
std::string page(std::string_view title, std::string_view body);

}  // namespace atomcam::report
