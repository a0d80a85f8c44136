#pragma once

namespace anigen {

inline constexpr const char kVersion[] = "0.1.0";

}  // namespace anigen
