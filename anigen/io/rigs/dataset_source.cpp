#include "anigen/io/rigs/dataset_source.h"

#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/rigs/file_list.h"
#include "anigen/io/rigs/rig_arrays.h"

namespace anigen::io {

DatasetSource::DatasetSource(const std::filesystem::path& root, const SourceOptions& options)
    : root_(root), options_(options), items_(list_dataset(root)) {
  for (std::size_t i = 0; i < items_.size(); ++i) index_.emplace(items_[i].id, i);
}

const DatasetItem& DatasetSource::item(const std::string& id) const {
  const auto found = index_.find(id);
  if (found == index_.end()) throw InputError((root_ / "metadata.csv").string(), "", "has no id \"" + id + "\"");
  return items_[found->second];
}

std::vector<std::string> DatasetSource::ids() const {
  std::vector<std::string> result;
  for (const DatasetItem& item : items_) result.push_back(item.id);
  return result;
}

RiggedShape DatasetSource::read(const std::string& id) const {
  const DatasetItem& row = item(id);
  const std::filesystem::path file = root_ / "skeleton" / id / "skeleton_voxelized.npz";
  require_content(file);
  RiggedShape shape = read_rig_npz(file, id);
  turn_to_z_up(shape, options_.axes, Axes::kZUp);
  if (!row.usable) shape.notes.push_back("the data set marks its skeleton as bad");
  if (row.bad_skin) shape.notes.push_back("the data set marks its skin as bad");
  return shape;
}

std::vector<std::filesystem::path> DatasetSource::files(const std::string& id) const {
  return {root_ / "metadata.csv", root_ / "skeleton" / id / "skeleton_voxelized.npz", root_ / "assets" / (id + ".glb")};
}

std::string DatasetSource::describe() const {
  return "data set " + root_.string() + ": " + std::to_string(items_.size()) + " samples";
}

std::vector<std::string> DatasetSource::other_names(const std::string& id) const { return item(id).other_names; }

std::string DatasetSource::category(const std::string& id) const {
  static const std::string kPrefix = "procedural:";
  const std::string& source = item(id).source;
  return source.rfind(kPrefix, 0) == 0 ? source.substr(kPrefix.size()) : "";
}

}  // namespace anigen::io
