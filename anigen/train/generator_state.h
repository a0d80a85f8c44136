#pragma once
#include <string>

namespace anigen::train {

/// State of LibTorch's own generator on the CPU, which some baselines draw from, as bytes.
std::string generator_state();
/// @throws c10::Error for bytes that are no such state
void set_generator_state(const std::string& bytes);

}  // namespace anigen::train
