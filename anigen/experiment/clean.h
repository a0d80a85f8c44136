#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// Folders, records and logs in an experiment's folder that its plan no longer names: results of settings and code that
/// have changed since.
struct Leftover {
  std::string id;
  std::uint64_t bytes = 0;
};

std::vector<Leftover> find_leftovers(const std::filesystem::path& out, const Plan& plan);

/// Removes them, and nothing else. @throws Error naming what could not be removed
void remove_leftovers(const std::filesystem::path& out, const std::vector<Leftover>& leftovers);

}  // namespace anigen::experiment
