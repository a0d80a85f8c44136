#pragma once
#include <vector>

namespace anigen {

/// Percentile p (0–100) of the values, linearly interpolated between neighbours as numpy does by default.
/// @pre values is not empty
double percentile(std::vector<float> values, double p);

}  // namespace anigen
