#pragma once
#include <filesystem>
#include <optional>
#include <vector>

#include "anigen/io/image.h"
#include "anigen/prepare/run/dataset_rows.h"

namespace anigen::prepare {

/// A contact sheet of assets spread evenly over the dataset, each with its skeleton drawn over it, from what the
/// dataset holds: assets/<id>.glb, else skeleton_voxelized.npz. @return nothing when it holds neither of any
std::optional<io::Image> card_pictures(const std::filesystem::path& out, const std::vector<DatasetRow>& rows);

}  // namespace anigen::prepare
