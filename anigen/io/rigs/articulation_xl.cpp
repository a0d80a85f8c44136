#include "anigen/io/rigs/articulation_xl.h"

#include <unistd.h>
#include <algorithm>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/arrays/npz_objects.h"
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
  explicit ArticulationXlSource(const std::filesystem::path& file, const SourceOptions& options)
      : file_(file.string()) {
    const NpzValue samples = sample_list(file);
    for (std::size_t i = 0; i < samples.items.size(); ++i) add(samples.items[i], i, options);
  }

  std::vector<std::string> ids() const override { return ids_; }
  RiggedShape read(const std::string& id) const override {
    const Sample& kept = sample(id);
    if (!kept.sound) throw InputError(file_, kept.place, kept.problem);
    return kept.shape;
  }

  std::vector<std::filesystem::path> files(const std::string&) const override { return {file_}; }
  std::string describe() const override {
    constexpr std::size_t kMebibyte = std::size_t{1} << 20;
    return "Articulation-XL file " + file_ + ": " + std::to_string(ids_.size()) + " samples, " +
           std::to_string((bytes_ + kMebibyte - 1) / kMebibyte) + " MiB in memory";
  }

  std::string sample_id(const std::string& id) const override { return sample(id).content_id; }

  bool is_single_file() const override { return ids_.size() == 1; }

 private:
  struct Sample {
    RiggedShape shape;
    std::string place, problem;  ///< of a sample that cannot be read
    std::string content_id;
    bool sound = false;
  };
  void add(const NpzValue& sample, std::size_t index, const SourceOptions& options) {
    const std::string place = "sample " + std::to_string(index);
    const NpzValue* uuid = sample.find("uuid");
    if (uuid == nullptr || uuid->kind != NpzValue::Kind::kString || uuid->text.empty())
      throw InputError(file_, place, "has no uuid");
    const std::string id = uuid->text;
    const auto [there, is_new] = samples_.try_emplace(id);
    if (!is_new) throw InputError(file_, place, "the uuid " + id + " appears twice");
    ids_.push_back(id);
    Sample& kept = there->second;
    try {
      kept.shape = shape_from_articulation_xl(sample, id, file_, options.content_ids ? &kept.content_id : nullptr);
      turn_to_z_up(kept.shape, options.axes, Axes::kZUp);
      kept.sound = true;
      bytes_ += kept_bytes(kept.shape);
    } catch (const InputError& error) {
      kept.place = "sample " + id + (error.place().empty() ? "" : ", " + error.place());
      kept.problem = error.problem();
    }
  }

  const Sample& sample(const std::string& id) const {
    const auto found = samples_.find(id);
    if (found == samples_.end()) throw InputError(file_, "", "has no sample \"" + id + "\"");
    return found->second;
  }

  std::string file_;
  std::vector<std::string> ids_;
  std::map<std::string, Sample> samples_;
  std::size_t bytes_ = 0;
};

}  // namespace

std::unique_ptr<ShapeSource> open_articulation_xl(const std::filesystem::path& file, const SourceOptions& options) {
  return std::make_unique<ArticulationXlSource>(file, options);
}

}  // namespace anigen::io
