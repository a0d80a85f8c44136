#include "anigen/prepare/import_asset.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "anigen/asset/normalize.h"
#include "anigen/prepare/creatures/creature.h"

namespace anigen::prepare {

std::size_t invented_rows(const std::vector<io::ImportNote>& notes) {
  std::size_t rows = 0;
  for (const io::ImportNote& note : notes) {
    // These two notes start with the number of vertices that were bound like their neighbours.
    if (note.code == "nan_weights" || note.code == "zero_weights")
      rows += std::strtoull(note.message.c_str(), nullptr, 10);
  }
  return rows;
}

PreparedAsset import_asset(const AssetSource& source) {
  PreparedAsset prepared;
  AssetRecord& record = prepared.record;
  if (source.procedural()) {
    prepared.asset = make_creature(source.seed, source.index);
    record.source = "procedural:" + creature_family(source.seed, source.index);
  } else {
    io::ImportedAsset imported = io::read_gltf(source.file);
    prepared.asset = std::move(imported.asset);
    record.source = "real";
    record.invented_rows = invented_rows(imported.notes);
    for (const io::ImportNote& note : imported.notes) {
      if (std::find(record.repairs.begin(), record.repairs.end(), note.code) == record.repairs.end()) {
        record.repairs.push_back(note.code);
      }
    }
  }
  Asset& asset = prepared.asset;
  const Similarity similarity = normalize(asset);
  record.scale = similarity.scale;
  record.offset = {similarity.offset.x(), similarity.offset.y(), similarity.offset.z()};
  record.num_joints = asset.skeleton.size();
  record.num_vertices = asset.mesh.vertices.size();
  record.num_faces = asset.mesh.faces.size();
  record.max_influences = asset.skin.largest_row();
  std::vector<Eigen::Vector3f> joints;
  for (const Eigen::Vector3d& p : asset.skeleton.positions()) joints.push_back(p.cast<float>());
  record.closest_bones = closest_bones(joints, asset.skeleton.parents);
  return prepared;
}

}  // namespace anigen::prepare
