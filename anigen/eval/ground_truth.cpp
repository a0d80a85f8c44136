#include "anigen/eval/ground_truth.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/eval/inputs/split.h"
#include "anigen/eval/skin_metrics.h"
#include "anigen/io/npz.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

/// One member of an archive with its expected shape, -1 standing for any size.
const io::NdArray& member(const io::NamedArrays& arrays, const std::string& name,
                          const std::vector<std::int64_t>& shape, const fs::path& file) {
  const io::NdArray* array = io::find(arrays, name);
  if (array == nullptr) throw InputError(file.string(), name, "the array is missing");
  bool fits = array->shape.size() == shape.size();
  std::string wanted;
  for (std::size_t i = 0; i < shape.size(); ++i) {
    fits = fits && (shape[i] < 0 || array->shape[i] == shape[i]);
    wanted += (i == 0 ? "" : ", ") + (shape[i] < 0 ? std::string("any") : std::to_string(shape[i]));
  }
  if (!fits) throw InputError(file.string(), name, "expected shape [" + wanted + "]");
  return *array;
}

std::vector<Eigen::Vector3f> points(const io::NdArray& array, const std::string& name, const fs::path& file) {
  const std::vector<float> values = array.as<float>();
  std::vector<Eigen::Vector3f> result(values.size() / 3);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(values[i])) {
      throw InputError(file.string(), name + "[" + std::to_string(i / 3) + "]", "is not finite");
    }
    result[i / 3][static_cast<Eigen::Index>(i % 3)] = values[i];
  }
  return result;
}

/// Whole numbers that fit an int. as<int32_t>() refuses others with an Error that does not know the file.
std::vector<std::int32_t> integers(const io::NdArray& array, const std::string& name, const fs::path& file) {
  try {
    return array.as<std::int32_t>();
  } catch (const InputError&) {
    throw;
  } catch (const Error& error) {
    throw InputError(file.string(), name, error.what());
  }
}

}  // namespace

std::vector<DatasetItem> list_dataset(const fs::path& root) {
  const fs::path file = root / "metadata.csv";
  const CsvTable table = read_csv(file);
  if (table.column("sha256") == CsvTable::kMissing) throw InputError(file.string(), "line 1", "no column \"sha256\"");
  std::vector<DatasetItem> items;
  std::set<std::string> seen;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    DatasetItem item;
    item.id = table.cell(row, "sha256");
    const std::string place = "row " + std::to_string(row + 1);
    const bool unsafe = item.id.empty() || item.id == "." || item.id == ".." || item.id.find('/') != std::string::npos;
    if (unsafe) throw InputError(file.string(), place, "\"" + item.id + "\" is no id");
    if (!seen.insert(item.id).second) throw InputError(file.string(), place, "the id " + item.id + " appears twice");
    item.source = table.cell(row, "source");
    for (const char* column : {"local_path", "file_identifier", "sha256"}) {
      if (item.name.empty()) item.name = table.cell(row, column);
    }
    item.usable = !table.flag(row, "is_bad_skeleton", false, file.string());
    item.bad_skin = table.flag(row, "is_bad_skin", false, file.string());
    items.push_back(std::move(item));
  }
  return items;
}

std::vector<DatasetItem> select_split(const std::vector<DatasetItem>& items, const std::vector<fs::path>& splits) {
  std::set<std::string> known, wanted;
  for (const DatasetItem& item : items) known.insert(item.id);
  for (const fs::path& split : splits) {
    for (const SplitLine& line : split_lines(split)) {
      if (known.count(line.id) == 0) {
        throw InputError(split.string(), "line " + std::to_string(line.line),
                         "the dataset has no id \"" + line.id + "\"");
      }
      wanted.insert(line.id);
    }
  }
  std::vector<DatasetItem> selected;
  for (const DatasetItem& item : items) {
    if (wanted.count(item.id) > 0) selected.push_back(item);
  }
  return selected;
}

GroundTruth read_ground_truth(const fs::path& root, const std::string& id) {
  const fs::path file = root / "skeleton" / id / "skeleton_voxelized.npz";
  const io::NamedArrays arrays = io::read_npz(file, {"joints", "parents", "skin", "vertices", "faces"});
  GroundTruth truth;
  truth.joints = points(member(arrays, "joints", {-1, 3}, file), "joints", file);
  truth.vertices = points(member(arrays, "vertices", {-1, 3}, file), "vertices", file);
  const auto joints = static_cast<std::int64_t>(truth.joints.size());
  const auto vertices = static_cast<std::int64_t>(truth.vertices.size());
  if (joints == 0) throw InputError(file.string(), "joints", "there is not one joint");
  if (vertices == 0) throw InputError(file.string(), "vertices", "there is not one vertex");
  truth.parents = integers(member(arrays, "parents", {joints}, file), "parents", file);
  for (std::size_t j = 0; j < truth.parents.size(); ++j) {
    const int parent = truth.parents[j];
    if (parent < -1 || parent >= joints || parent == static_cast<int>(j)) {
      throw InputError(file.string(), "parents[" + std::to_string(j) + "]",
                       "is out of range: " + std::to_string(parent));
    }
  }
  truth.skin = member(arrays, "skin", {vertices, joints}, file).as<float>();
  const std::size_t columns = truth.joints.size();
  for (std::size_t v = 0; v < truth.vertices.size(); ++v) {
    float* row = truth.skin.data() + v * columns;
    if (std::all_of(row, row + columns, [](float w) { return w == 0.0f; })) row[0] = 1.0f;
  }
  normalize_rows(truth.skin, truth.vertices.size(), columns, file.string());
  const std::vector<std::int32_t> corners = integers(member(arrays, "faces", {-1, 3}, file), "faces", file);
  truth.faces.resize(corners.size() / 3);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] < 0 || corners[i] >= vertices) {
      throw InputError(file.string(), "faces[" + std::to_string(i / 3) + "]",
                       "names vertex " + std::to_string(corners[i]) + " of " + std::to_string(vertices));
    }
    truth.faces[i / 3][i % 3] = corners[i];
  }
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
