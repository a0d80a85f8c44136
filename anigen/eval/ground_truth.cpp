#include "anigen/eval/ground_truth.h"

#include <algorithm>
#include <cstdint>
#include <set>

#include "anigen/core/error.h"
#include "anigen/eval/skin_metrics.h"
#include "anigen/io/npz.h"
#include "anigen/io/rigs/array_fields.h"
#include "anigen/io/rigs/joint_tree.h"
#include "anigen/io/rigs/split.h"

namespace anigen::eval {

namespace fs = std::filesystem;

std::vector<io::DatasetItem> select_split(const std::vector<io::DatasetItem>& items,
                                          const std::vector<fs::path>& splits) {
  io::NameIndex index;
  std::set<std::string> known, wanted;
  for (const io::DatasetItem& item : items) {
    known.insert(item.id);
    index.add(item.id, item.other_names);
  }
  for (const fs::path& split : splits) {
    for (const io::SplitLine& line : io::split_lines(split)) {
      const std::string place = "line " + std::to_string(line.line);
      const std::string id = known.count(line.id) > 0 ? line.id : index.find_one(line.id, split.string(), place);
      if (id.empty()) throw InputError(split.string(), place, "the dataset has no asset called \"" + line.id + "\"");
      wanted.insert(id);
    }
  }
  std::vector<io::DatasetItem> selected;
  for (const io::DatasetItem& item : items) {
    if (wanted.count(item.id) > 0) selected.push_back(item);
  }
  return selected;
}

GroundTruth read_ground_truth(const fs::path& root, const std::string& id) {
  const fs::path file = root / "skeleton" / id / "skeleton_voxelized.npz";
  const io::NamedArrays arrays = io::read_npz(file, {"joints", "parents", "skin", "vertices", "faces"});
  const io::ArrayFields fields(arrays, file.string());
  GroundTruth truth;
  fields.array("joints", {-1, 3});
  truth.joints = fields.points("joints");
  fields.array("vertices", {-1, 3});
  truth.vertices = fields.points("vertices");
  const auto joints = static_cast<std::int64_t>(truth.joints.size());
  const auto vertices = static_cast<std::int64_t>(truth.vertices.size());
  if (vertices == 0) fields.fail("vertices", "there is not one vertex");
  truth.parents = fields.integers("parents", {joints});
  io::check({fields.precise_points("joints"), truth.parents}, file.string());
  truth.skin = fields.reals("skin", {vertices, joints});
  const std::size_t columns = truth.joints.size();
  for (std::size_t v = 0; v < truth.vertices.size(); ++v) {
    float* row = truth.skin.data() + v * columns;
    if (std::any_of(row, row + columns, [](float w) { return w != 0.0f; })) continue;
    row[0] = 1.0f;
    ++truth.unweighted;
  }
  normalize_rows(truth.skin, truth.vertices.size(), columns, file.string());
  truth.faces = fields.triangles("faces", truth.vertices.size());
  return truth;
}

Asset to_asset(const GroundTruth& truth, const std::vector<float>& skin) {
  Asset asset;
  asset.mesh.vertices = truth.vertices;
  asset.mesh.faces = truth.faces;
  std::vector<Eigen::Vector3d> positions;
  for (const Eigen::Vector3f& p : truth.joints) positions.push_back(p.cast<double>());
  asset.skeleton = skeleton_from_joints(positions, truth.parents);
  asset.skin = from_dense(skin, truth.vertex_count(), truth.joint_count());
  return asset;
}

}  // namespace anigen::eval
