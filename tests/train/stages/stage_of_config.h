#pragma once
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "anigen/train/stage.h"

namespace anigen::test {

/// The stage of a config as a run begins with it. @param data folder of the dataset
std::unique_ptr<train::Stage> stage_of_config(const std::string& config, const std::filesystem::path& data,
                                              const std::vector<std::string>& overrides = {},
                                              torch::Device device = torch::kCPU);

/// All weights drawn anew, away from zero, where many published starts have them: there outputs do not depend on
/// inputs.
void draw_weights(const train::Stage& stage);

}  // namespace anigen::test
