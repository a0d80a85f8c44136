#include "anigen/prepare/steps/import_columns.h"

#include "anigen/core/error.h"
#include "anigen/prepare/skeleton_checks.h"

namespace anigen::prepare {

Json import_columns(const AssetRecord& record) { return to_json(record); }

Json variant_columns(const Json& source, const Asset* posed, const Provenance& provenance) {
  if (posed == nullptr) return {{"rejected_pose", true}, {"pose", to_json(provenance)}};
  AssetRecord record = record_from_columns(source);
  // Posing keeps mesh and tree; only lengths change, by the new normalisation, and directions.
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& p : posed->skeleton.positions()) joints.push_back(p.cast<float>());
  record.closest_bones = closest_bones(joints, posed->skeleton.parents);
  const Similarity again = provenance.renormalization;
  record.scale *= again.scale;
  for (std::size_t i = 0; i < 3; ++i) {
    record.offset[i] = again.scale * record.offset[i] + again.offset[static_cast<Eigen::Index>(i)];
  }
  Json columns = to_json(record);
  columns["pose"] = to_json(provenance);
  return columns;
}

Similarity normalisation_of(const Json& columns) {
  const AssetRecord record = record_from_columns(columns);
  return {record.scale, Eigen::Vector3d(record.offset[0], record.offset[1], record.offset[2])};
}

bool is_rejected_pose(const Json& columns) { return columns.contains("rejected_pose"); }

bool readable(const Json& columns) {
  if (is_rejected_pose(columns)) return true;
  try {
    record_from_columns(columns);
    return true;
  } catch (const InputError&) {
    return false;
  }
}

AssetRecord record_from_columns(const Json& columns) {
  try {
    AssetRecord record = asset_record_from_json(columns);
    if (record.offset.size() != 3) throw InputError("", "", "the record of an asset is damaged: offset");
    return record;
  } catch (const Json::exception& error) {
    throw InputError("", "", std::string("the record of an asset is damaged: ") + error.what());
  }
}

}  // namespace anigen::prepare
