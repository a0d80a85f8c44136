#include "anigen/prepare/import_asset.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "anigen/asset/normalize.h"
#include "anigen/prepare/cleaning/coarser_skeleton.h"
#include "anigen/prepare/creatures/creature.h"

namespace anigen::prepare {
namespace {

/// The numbers that notes of one of these codes start with, added up.
std::size_t told_count(const std::vector<io::ImportNote>& notes, const std::vector<std::string>& codes) {
  std::size_t count = 0;
  for (const io::ImportNote& note : notes) {
    if (std::find(codes.begin(), codes.end(), note.code) != codes.end())
      count += std::strtoull(note.message.c_str(), nullptr, 10);
  }
  return count;
}

void measure(const Asset& asset, AssetRecord& record) {
  record.num_joints = asset.skeleton.size();
  record.num_vertices = asset.mesh.vertices.size();
  record.num_faces = asset.mesh.faces.size();
  record.max_influences = asset.skin.largest_row();
  const std::vector<Eigen::Vector3d> positions = asset.skeleton.positions();
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& p : positions) joints.push_back(p.cast<float>());
  record.closest_bones = closest_bones(joints, asset.skeleton.parents);
  record.outside_share = outside_share(positions, bounding_box(asset.mesh.vertices));
  record.skeleton = describe(asset.skeleton);
}

}  // namespace

std::size_t invented_rows(const std::vector<io::ImportNote>& notes) {
  return told_count(notes, {"nan_weights", "zero_weights"});
}

PreparedAsset import_asset(const AssetSource& source, const CleaningOptions& cleaning, const io::RigReader& reader) {
  PreparedAsset prepared;
  AssetRecord& record = prepared.record;
  if (source.procedural()) {
    prepared.asset = make_creature(source.seed, source.index);
    record.source = "procedural:" + creature_family(source.seed, source.index);
  } else {
    io::ImportedAsset imported = reader.read(source.rig());
    prepared.asset = std::move(imported.asset);
    record.source = "real";
    record.invented_rows = invented_rows(imported.notes);
    record.lowest_weight_sum = imported.lowest_weight_sum;
    record.repeated_names = told_count(imported.notes, {"duplicate_joint_names"});
    for (const io::ImportNote& note : imported.notes) {
      if (std::find(record.repairs.begin(), record.repairs.end(), note.code) == record.repairs.end())
        record.repairs.push_back(note.code);
    }
  }
  const Similarity similarity = normalize(prepared.asset);
  record.scale = similarity.scale;
  record.offset = {similarity.offset.x(), similarity.offset.y(), similarity.offset.z()};
  if (!source.procedural()) {
    const ReadQuality quality{record.lowest_weight_sum, record.repeated_names};
    record.findings = clean(prepared.asset, quality, cleaning, source.file_identifier);
  }
  if (auto finding = coarsen_skeleton(prepared.asset, cleaning.kept_joints, source.file_identifier))
    record.findings.push_back(std::move(*finding));
  measure(prepared.asset, record);
  return prepared;
}

PreparedAsset import_asset(const AssetSource& source) { return import_asset(source, {}, io::RigReader()); }

}  // namespace anigen::prepare
