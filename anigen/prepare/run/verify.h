#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/prepare/run/manifest.h"
#include "anigen/prepare/steps/step_plan.h"

namespace anigen::prepare {

/// What is missing in a dataset that should be complete: of every source and every posed variant there must be a record
/// or the failure that kept it out; every step of the plan must be recorded, unless one of this asset failed, and of
/// every such record all files must be there, with as many bytes as it says. Looks at names and sizes, on all threads,
/// and reads no contents: files come into being by rename, so one of the right size is whole.
/// @return a sentence per gap, in order of the sources; empty: nothing is missing
std::vector<std::string> find_gaps(const std::filesystem::path& out, const std::vector<Manifest>& manifests,
                                   const StepPlan& plan);

}  // namespace anigen::prepare
