#include "anigen/io/rigs/articulation_xl.h"

#include <unistd.h>
#include <algorithm>
#include <cstdint>
#include <deque>
#include <mutex>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/npz_objects.h"
#include "anigen/io/arrays/npz_samples.h"
#include "anigen/io/rigs/rig_reader.h"

namespace anigen::io {

namespace {

constexpr double kReadingFactor = 3.0;  // the pickle, its arrays, and the tree made of them

std::size_t kept_bytes(const RiggedShape& shape) {
  const Mesh& mesh = shape.mesh;
  return sizeof(RiggedShape) + mesh.vertices.capacity() * sizeof(mesh.vertices[0]) +
         mesh.faces.capacity() * sizeof(Triangle) + mesh.normals.capacity() * sizeof(mesh.normals[0]) +
         shape.joints.size() * (sizeof(Eigen::Vector3d) + sizeof(int) + sizeof(std::string)) +
         shape.skin.offsets.capacity() * sizeof(std::size_t) + shape.skin.influences.capacity() * sizeof(Influence);
}

bool holds_samples(const NpzValue& value) {
  using Kind = NpzValue::Kind;
  return value.kind == Kind::kList && !value.items.empty() && value.items.front().kind == Kind::kDict;
}

constexpr double kGibibyte = 1024.0 * 1024.0 * 1024.0;

/// Refused before it is tried: the system would rather end the program than the allocation.
void require_memory(const ZipReader& archive, const ZipMember& member) {
  const double needed = kReadingFactor * static_cast<double>(member.bytes);
  const double there = static_cast<double>(::sysconf(_SC_PHYS_PAGES)) * static_cast<double>(::sysconf(_SC_PAGESIZE));
  if (needed <= there) return;
  const auto gibibytes = [](double bytes) { return std::to_string(static_cast<long>(bytes / kGibibyte)) + " GiB"; };
  throw InputError(archive.file(), member.name,
                   "reading it takes about " + gibibytes(needed) + " of memory and this machine has " +
                       gibibytes(there) + "; split the file");
}

/// Members one after the other, so that strays behind the list are not read.
NpzValue sample_list(const std::filesystem::path& file) {
  std::vector<std::string> names;
  {
    const ZipReader archive(file);
    for (const ZipMember& member : archive.members()) {
      const std::size_t end = member.name.rfind(".npy");
      if (end != std::string::npos && end + 4 == member.name.size()) {
        require_memory(archive, member);
        names.push_back(member.name.substr(0, end));
      }
    }
  }
  for (const std::string& name : names) {
    if (name == "allow_pickle") continue;
    NpzValue value = std::move(read_npz_objects(file, {name}).front().second);
    if (holds_samples(value)) return value;
  }
  if (lower_case(file.string()).find("tailorrig") != std::string::npos)
    throw NotSupportedError(file.string(), "", "TailorRig's files, whose layout is not published");
  throw InputError(file.string(), "", "holds neither the arrays joints and vertices nor a list of sample dictionaries");
}

/// The dictionary's numbers under their keys; lists of numbers count as arrays.
NamedArrays numeric_items(const NpzValue& sample, const std::string& file) {
  NamedArrays arrays;
  for (std::size_t i = 0; i < sample.items.size(); ++i) {
    const std::string& key = sample.keys[i];
    if (key == "pc_w_norm" || key == "uuid" || key == "joint_names") continue;
    if (sample.items[i].kind == NpzValue::Kind::kNone || sample.items[i].kind == NpzValue::Kind::kString) continue;
    append_numeric_leaves(sample.items[i], key, {file, key}, arrays);
  }
  return arrays;
}

std::vector<int> parents_from_bones(const ArrayFields& fields, std::size_t joints) {
  std::vector<int> parents(joints, -1);
  if (!fields.has("bones") || fields.rows("bones") == 0) return parents;
  const std::vector<std::int32_t> ends = fields.integers("bones", {-1, 2});
  for (std::size_t b = 0; b < ends.size() / 2; ++b) {
    const std::int32_t parent = ends[2 * b], child = ends[2 * b + 1];
    const std::string place = "bones[" + std::to_string(b) + "]";
    for (const std::int32_t end : {parent, child}) {
      if (end < 0 || static_cast<std::size_t>(end) >= joints)
        fields.fail(place, "names joint " + std::to_string(end) + " of " + std::to_string(joints));
    }
    int& known = parents[at(child)];
    if (known >= 0 && known != parent)
      fields.fail(place, "joint " + std::to_string(child) + " already has the parent " + std::to_string(known));
    known = parent;
  }
  return parents;
}

/// Released files say `…_row`, the published writer `…_rows`.
std::string index_key(const ArrayFields& fields, const std::string& name) {
  const std::string found = fields.first_of({name, name + "s"});
  if (found.empty()) fields.fail(name, "the array is missing");
  return found;
}

void read_skin(const ArrayFields& fields, RiggedShape& shape) {
  const std::string value = "skinning_weights_value", sizes = "skinning_weights_shape";
  if (!fields.has(value)) return;
  const auto vertices = static_cast<std::int64_t>(shape.mesh.vertices.size());
  const auto joints = static_cast<std::int64_t>(shape.joints.size());
  if (fields.has(sizes)) {
    const std::vector<std::int32_t> told = fields.integers(sizes, {2});
    if (told[0] != vertices || told[1] != joints) {
      fields.fail(sizes, "weights for " + std::to_string(told[0]) + " vertices and " + std::to_string(told[1]) +
                             " joints, but there are " + std::to_string(vertices) + " and " + std::to_string(joints));
    }
  }
  const std::int64_t count = fields.rows(value);
  const std::string row_key = index_key(fields, "skinning_weights_row");
  const std::string column_key = index_key(fields, "skinning_weights_col");
  const std::vector<float> weights = fields.reals(value, {count});
  const std::vector<std::int32_t> rows = fields.integers(row_key, {count});
  const std::vector<std::int32_t> columns = fields.integers(column_key, {count});
  SkinRows skin(shape.mesh.vertices.size(), shape.joints.size(), fields.file());
  for (std::size_t i = 0; i < weights.size(); ++i)
    skin.add(rows[i], columns[i], weights[i], value + "[" + std::to_string(i) + "]");
  skin.finish(first_root(shape.joints), shape);
}

void read_root(const ArrayFields& fields, RiggedShape& shape) {
  if (!fields.has("root_index")) return;
  const std::int32_t root = fields.integer("root_index");
  if (root < 0 || static_cast<std::size_t>(root) >= shape.joints.size())
    fields.fail("root_index", std::to_string(root) + " of " + std::to_string(shape.joints.size()) + " joints");
  if (shape.joints.parents[at(root)] >= 0)
    shape.notes.push_back("root_index names joint " + std::to_string(root) + ", which its bones give a parent");
}

void read_names(const NpzValue& sample, RiggedShape& shape) {
  const NpzValue* names = sample.find("joint_names");
  if (names == nullptr || names->items.size() != shape.joints.size()) return;
  for (const NpzValue& name : names->items) shape.joint_names.push_back(name.text);
}

}  // namespace

RiggedShape shape_from_articulation_xl(const NpzValue& sample, const std::string& id, const std::string& file,
                                       std::string* content_id) {
  if (sample.kind != NpzValue::Kind::kDict) throw InputError(file, "", "the sample is no dictionary");
  const NamedArrays arrays = numeric_items(sample, file);
  if (content_id != nullptr) *content_id = io::content_id(arrays);
  const ArrayFields fields(arrays, file);
  RiggedShape shape = shape_with_mesh(fields, "normals", id, file);
  if (fields.has("joints")) {
    shape.joints.positions = fields.points<Eigen::Vector3d>("joints");
    shape.joints.parents = parents_from_bones(fields, shape.joints.positions.size());
    anigen::check(shape.joints, file);
    read_root(fields, shape);
    read_names(sample, shape);
    read_skin(fields, shape);
  }
  note_missing_parts(shape);
  return shape;
}

namespace {

class ArticulationXlSource : public ShapeSource {
 public:
  ArticulationXlSource(const std::filesystem::path& file, const SourceOptions& options)
      : file_(file.string()), options_(options), apart_(NpzSamples::open(file, "uuid")) {
    for (std::size_t i = 0; apart_ && i < apart_->size(); ++i) add_id(apart_->name(i), i);
    if (apart_) return;
    const NpzValue samples = sample_list(file);
    for (std::size_t i = 0; i < samples.items.size(); ++i) {
      const NpzValue* uuid = samples.items[i].find("uuid");
      add_id(uuid != nullptr && uuid->kind == NpzValue::Kind::kString ? uuid->text : "", i);
      keep(samples.items[i]);
    }
  }

  std::vector<std::string> ids() const override { return ids_; }
  RiggedShape read(const std::string& id) const override {
    const std::size_t i = index(id);
    if (apart_) return read_apart(i);
    if (!kept_[i].problem.empty()) throw InputError(file_, kept_[i].place, kept_[i].problem);
    return kept_[i].shape;
  }

  std::vector<std::filesystem::path> files(const std::string&) const override { return {file_}; }
  std::string describe() const override {
    constexpr std::size_t kMebibyte = std::size_t{1} << 20;
    const std::string text = "Articulation-XL file " + file_ + ": " + std::to_string(ids_.size()) + " samples";
    return apart_ ? text : text + ", " + std::to_string((bytes_ + kMebibyte - 1) / kMebibyte) + " MiB in memory";
  }

  std::string sample_id(const std::string& id) const override {
    const std::size_t i = index(id);
    if (!options_.content_ids) return "";
    if (!apart_) return kept_[i].content_id;
    std::string content;
    const NpzValue sample = apart(i);
    try {
      shape_of(sample, id, &content);
    } catch (const InputError&) {
      if (content.empty()) throw;
    }
    return content;
  }

  bool is_single_file() const override { return ids_.size() == 1; }

 private:
  struct Kept {
    RiggedShape shape;
    std::string place, problem;  ///< of a sample that cannot be read
    std::string content_id;
  };

  void add_id(const std::string& id, std::size_t index) {
    const std::string place = "sample " + std::to_string(index);
    if (id.empty()) throw InputError(file_, place, "has no uuid");
    if (!indices_.emplace(id, index).second) throw InputError(file_, place, "the uuid " + id + " appears twice");
    ids_.push_back(id);
  }

  std::size_t index(const std::string& id) const {
    const auto found = indices_.find(id);
    if (found == indices_.end()) throw InputError(file_, "", "has no sample \"" + id + "\"");
    return found->second;
  }

  /// Several methods are compared with a truth one after the other: the last few samples stay.
  RiggedShape read_apart(std::size_t index) const {
    constexpr std::size_t kRecent = 4;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      for (const auto& [known, shape] : recent_) {
        if (known == index) return *shape;
      }
    }
    auto shape = std::make_shared<const RiggedShape>(shape_of(apart(index), ids_[index], nullptr));
    const std::lock_guard<std::mutex> lock(mutex_);
    recent_.emplace_front(index, shape);
    if (recent_.size() > kRecent) recent_.pop_back();
    return *shape;
  }

  NpzValue apart(std::size_t index) const {
    try {
      return apart_->read(index);
    } catch (const InputError& error) {
      throw InputError(file_, "sample " + ids_[index] + ", " + error.place(), error.problem());
    }
  }

  RiggedShape shape_of(const NpzValue& sample, const std::string& id, std::string* content_id) const {
    try {
      RiggedShape shape = shape_from_articulation_xl(sample, id, file_, content_id);
      turn_to_z_up(shape, options_.axes, Axes::kZUp);
      return shape;
    } catch (const InputError& error) {
      throw InputError(file_, "sample " + id + (error.place().empty() ? "" : ", " + error.place()), error.problem());
    }
  }

  void keep(const NpzValue& sample) {
    Kept& kept = kept_.emplace_back();
    try {
      kept.shape = shape_of(sample, ids_.back(), options_.content_ids ? &kept.content_id : nullptr);
      bytes_ += kept_bytes(kept.shape);
    } catch (const InputError& error) {
      kept.place = error.place();
      kept.problem = error.problem();
    }
  }

  std::string file_;
  SourceOptions options_;
  std::unique_ptr<const NpzSamples> apart_;  ///< null: samples that share objects are read at once, and kept
  std::vector<std::string> ids_;
  std::unordered_map<std::string, std::size_t> indices_;
  std::vector<Kept> kept_;
  mutable std::mutex mutex_;
  mutable std::deque<std::pair<std::size_t, std::shared_ptr<const RiggedShape>>> recent_;
  std::size_t bytes_ = 0;
};

}  // namespace

std::unique_ptr<ShapeSource> open_articulation_xl(const std::filesystem::path& file, const SourceOptions& options) {
  return std::make_unique<ArticulationXlSource>(file, options);
}

}  // namespace anigen::io
