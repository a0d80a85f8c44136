#pragma once
#include <filesystem>

#include "anigen/core/csv.h"
#include "anigen/prepare/run/dataset_rows.h"
#include "anigen/prepare/skeleton_checks.h"
#include "anigen/prepare/steps/step_plan.h"

namespace anigen::prepare {

/// Writes what a dataset is at a glance: card.html (one file, pictures inside), card.md with card.png. Counts, sources,
/// histograms of joints, vertices and voxels, what cleaning did, what failed, how everything was made, and pictures of
/// assets spread evenly over the dataset. Equal datasets give equal bytes.
void write_card(const std::filesystem::path& out, const DatasetRows& found, const CsvTable& table, const StepPlan& plan,
                const QualityLimits& limits);

}  // namespace anigen::prepare
