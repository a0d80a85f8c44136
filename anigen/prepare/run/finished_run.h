#pragma once
#include <optional>

#include "anigen/prepare/dataset.h"

namespace anigen::prepare {

/// What the process that wrote the tables of a run leaves for the others, run/finished-<i>-of-<n>.json: that they are
/// written, and what is in them. @return nothing when they are not written yet
std::optional<PrepareSummary> read_finished(const std::filesystem::path& out, const Shard& shard);
void write_finished(const std::filesystem::path& out, const Shard& shard, const PrepareSummary& summary);  ///< atomic

}  // namespace anigen::prepare
