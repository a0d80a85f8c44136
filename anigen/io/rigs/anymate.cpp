#include "anigen/io/rigs/anymate.h"

#include <algorithm>
#include <map>
#include <mutex>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rig_reader.h"

namespace anigen::io {

namespace {

bool is_dict(const pickle::Value* value) { return value->kind == pickle::Kind::kDict; }

bool is_list(const pickle::Value& value) {
  return value.kind == pickle::Kind::kList || value.kind == pickle::Kind::kTuple ||
         value.kind == pickle::Kind::kObjectArray;
}

}  // namespace

struct AnymateArchive::Content {
  TorchFile file;
  std::vector<const pickle::Value*> samples;
};

AnymateArchive::AnymateArchive(const std::filesystem::path& file) : content_(new Content{TorchFile(file), {}}) {
  const pickle::Value& root = content_->file.root();
  std::vector<std::string> keys;
  if (is_list(root)) {
    for (const pickle::Value* value : root.items) content_->samples.push_back(value);
  } else if (is_dict(&root) && (find(root, "joints") != nullptr || find(root, "bones") != nullptr)) {
    content_->samples.push_back(&root);
  } else if (is_dict(&root)) {
    for (std::size_t i = 0; i + 1 < root.items.size(); i += 2) {
      keys.emplace_back(root.items[i]->text);
      content_->samples.push_back(root.items[i + 1]);
    }
  }
  const std::string stem = file.stem().string();
  const bool dicts = std::all_of(content_->samples.begin(), content_->samples.end(), is_dict);
  if (content_->samples.empty() || !dicts)
    throw InputError(file.string(), content_->file.place().member, "is no list of sample dictionaries");
  for (std::size_t i = 0; i < content_->samples.size(); ++i) {
    const pickle::Value* name = find(*content_->samples[i], "name");
    if (name != nullptr && name->kind == pickle::Kind::kString && !name->text.empty())
      names_.emplace_back(name->text);
    else if (!keys.empty() && !keys[i].empty())
      names_.push_back(keys[i]);
    else
      names_.push_back(content_->samples.size() == 1 ? stem : stem + "#" + std::to_string(i));
  }
}

NamedArrays AnymateArchive::sample(std::size_t index) const {
  return content_->file.arrays(*content_->samples.at(index));
}

namespace {

/// Weights per bone as pairs of index and weight, or dense, given to the joints at the bones' heads.
class BoneSkin {
 public:
  BoneSkin(const ArrayFields& fields, const std::vector<int>& heads, RiggedShape& shape)
      : fields_(fields),
        heads_(heads),
        shape_(shape),
        rows_(shape.mesh.vertices.size(), shape.joints.size(), fields.file()) {}

  void read(const std::string& name) {
    const std::string index = name + "_index", weight = name + "_weight";
    if (fields_.has(index))
      read_pairs(index, weight);
    else if (fields_.has(name))
      read_dense(name);
    else
      return;
    rows_.finish(first_root(shape_.joints), shape_);
  }

 private:
  std::int64_t vertices() const { return static_cast<std::int64_t>(shape_.mesh.vertices.size()); }

  void read_pairs(const std::string& index, const std::string& weight) {
    const std::int64_t width = fields_.array(index, {vertices(), -1}).shape[1];
    const std::vector<std::int32_t> bones = fields_.integers(index, {vertices(), width});
    const std::vector<float> weights = fields_.reals(weight, {vertices(), width});
    for (std::size_t i = 0; i < bones.size(); ++i) {
      if (bones[i] != -1) add(static_cast<std::int64_t>(i) / width, bones[i], weights[i], index);
    }
  }

  void read_dense(const std::string& name) {
    const std::int64_t width = fields_.array(name, {vertices(), -1}).shape[1];
    const std::vector<float> weights = fields_.reals(name, {vertices(), width});
    for (std::size_t i = 0; i < weights.size(); ++i) {
      const auto at = static_cast<std::int64_t>(i);
      if (weights[i] != 0.0f) add(at / width, static_cast<std::int32_t>(at % width), weights[i], name);
    }
  }

  void add(std::int64_t vertex, std::int32_t bone, float weight, const std::string& name) {
    const std::string place = name + "[" + std::to_string(vertex) + "]";
    if (bone < 0 || static_cast<std::size_t>(bone) >= heads_.size())
      fields_.fail(place, "names bone " + std::to_string(bone) + " of " + std::to_string(heads_.size()));
    rows_.add(vertex, heads_[at(bone)], weight, place);
  }

  const ArrayFields& fields_;
  const std::vector<int>& heads_;
  RiggedShape& shape_;
  SkinRows rows_;
};

constexpr double kSamePlace = 1e-4;  // bones are stored in single precision, predictions have joints averaged

struct Bone {
  Eigen::Vector3d head, tail;
};

/// An array's length, cut to the count that padded samples tell beside it.
std::size_t told_count(const ArrayFields& fields, const std::string& name, const std::string& count_name) {
  const auto rows = static_cast<std::size_t>(fields.rows(name));
  if (!fields.has(count_name)) return rows;
  const std::int32_t told = fields.integer(count_name);
  if (told < 0 || static_cast<std::size_t>(told) > rows)
    fields.fail(count_name, std::to_string(told) + " of " + std::to_string(rows) + " rows in " + name);
  return static_cast<std::size_t>(told);
}

std::vector<Bone> read_bones(const ArrayFields& fields) {
  if (!fields.has("bones") || fields.rows("bones") == 0) return {};
  fields.array("bones", {-1, 6});
  const std::vector<Eigen::Vector3d> heads = fields.points<Eigen::Vector3d>("bones");
  const std::vector<Eigen::Vector3d> tails = fields.points<Eigen::Vector3d>("bones", 3);
  std::vector<Bone> bones(told_count(fields, "bones", "bones_num"));
  for (std::size_t b = 0; b < bones.size(); ++b) bones[b] = {heads[b], tails[b]};
  return bones;
}

/// The nearest joint within kSamePlace, else -1.
int joint_at(const std::vector<Eigen::Vector3d>& joints, const Eigen::Vector3d& place) {
  int best = -1;
  double smallest = kSamePlace;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double distance = (joints[j] - place).norm();
    if (distance < smallest) {
      smallest = distance;
      best = static_cast<int>(j);
    }
  }
  return best;
}

std::vector<Eigen::Vector3d> unique_ends(const std::vector<Bone>& bones) {
  std::vector<Eigen::Vector3d> joints;
  const auto add = [&joints](const Eigen::Vector3d& place) {
    if (std::find(joints.begin(), joints.end(), place) == joints.end()) joints.push_back(place);
  };
  for (const Bone& bone : bones) add(bone.head);
  for (const Bone& bone : bones) add(bone.tail);
  return joints;
}

/// conns as parents, -1 for a root. @param rows of the dense form beyond the joints are padding
std::vector<int> read_parents(const ArrayFields& fields, std::size_t joints) {
  std::vector<int> parents(joints);
  const auto rows = static_cast<std::size_t>(fields.rows("conns"));
  if (rows < joints) fields.fail("conns", std::to_string(rows) + " parents for " + std::to_string(joints) + " joints");
  std::vector<std::int32_t> told;
  if (fields.array("conns").shape.size() == 1) {
    told = fields.integers("conns", {-1});
  } else {
    const auto columns = static_cast<std::size_t>(fields.array("conns", {-1, -1}).shape[1]);
    if (columns < joints)
      fields.fail("conns", std::to_string(columns) + " columns for " + std::to_string(joints) + " joints");
    const std::vector<float> scores = fields.reals("conns", {-1, -1});
    for (std::size_t j = 0; j < joints; ++j) {
      const auto row = scores.begin() + static_cast<std::ptrdiff_t>(j * columns);
      told.push_back(static_cast<std::int32_t>(std::max_element(row, row + static_cast<std::ptrdiff_t>(joints)) - row));
    }
  }
  for (std::size_t j = 0; j < joints; ++j) {
    const std::string place = "conns[" + std::to_string(j) + "]";
    if (told[j] < -1 || (told[j] >= 0 && static_cast<std::size_t>(told[j]) >= joints))
      fields.fail(place, "names joint " + std::to_string(told[j]) + " of " + std::to_string(joints));
    parents[j] = told[j] == static_cast<std::int32_t>(j) ? -1 : told[j];
  }
  return parents;
}

std::vector<int> parents_of_tails(const ArrayFields& fields, const std::vector<Eigen::Vector3d>& joints,
                                  const std::vector<Bone>& bones, const std::vector<int>& heads) {
  std::vector<int> parents(joints.size(), -1);
  for (std::size_t b = 0; b < bones.size(); ++b) {
    const std::string place = "bones[" + std::to_string(b) + "]";
    const int tail = joint_at(joints, bones[b].tail);
    if (tail < 0) fields.fail(place, "its tail is no joint");
    if (tail == heads[b]) continue;
    int& known = parents[at(tail)];
    if (known >= 0 && known != heads[b]) fields.fail(place, "two bones with different heads end at its tail");
    known = heads[b];
  }
  return parents;
}

/// The skeleton of a sample and which joint each of its bones starts at.
struct AnymateSkeleton {
  anigen::JointTree joints;    ///< not checked yet; empty when the sample has neither joints nor bones
  std::vector<int> bone_head;  ///< [K], index of a joint
};

AnymateSkeleton read_skeleton(const ArrayFields& fields) {
  AnymateSkeleton skeleton;
  if (!fields.has("joints") && !fields.has("bones")) return skeleton;
  std::vector<Eigen::Vector3d>& joints = skeleton.joints.positions;
  if (fields.has("joints")) {
    const std::size_t count = told_count(fields, "joints", "joints_num");
    joints = fields.points<Eigen::Vector3d>("joints");
    joints.resize(std::min(count, joints.size()));
  }
  const std::vector<Bone> bones = read_bones(fields);
  if (!fields.has("joints")) joints = unique_ends(bones);
  for (std::size_t b = 0; b < bones.size(); ++b) {
    const int head = joint_at(joints, bones[b].head);
    if (head < 0) fields.fail("bones[" + std::to_string(b) + "]", "its head is no joint");
    skeleton.bone_head.push_back(head);
  }
  skeleton.joints.parents = fields.has("conns") ? read_parents(fields, joints.size())
                                                : parents_of_tails(fields, joints, bones, skeleton.bone_head);
  if (!fields.has("bones")) {
    for (const int parent : skeleton.joints.parents) {
      if (parent >= 0) skeleton.bone_head.push_back(parent);
    }
  }
  return skeleton;
}

}  // namespace

RiggedShape shape_from_anymate(const NamedArrays& sample, const std::string& id, const std::string& file) {
  const ArrayFields fields(sample, file);
  RiggedShape shape(id, file);
  const bool whole_mesh = fields.has("mesh_pc") && fields.has("mesh_face");
  const std::string points = whole_mesh ? "mesh_pc" : fields.first_of({"pc", "mesh_pc"});
  if (!points.empty()) {
    shape.mesh.vertices = fields.points(points);
    if (whole_mesh) shape.mesh.faces = fields.triangles("mesh_face", shape.mesh.vertices.size());
    set_normals(shape, fields.unchecked_points(points, 3));
  }
  AnymateSkeleton skeleton = read_skeleton(fields);
  if (fields.has("joints") || fields.has("bones")) {
    anigen::check(skeleton.joints, file);
    shape.joints = std::move(skeleton.joints);
    if (!points.empty()) BoneSkin(fields, skeleton.bone_head, shape).read(points == "mesh_pc" ? "mesh_skins" : "skins");
  }
  note_missing_parts(shape);
  return shape;
}

namespace {

class AnymateSource : public ShapeSource {
 public:
  AnymateSource(const std::vector<std::filesystem::path>& files, const SourceOptions& options, bool single)
      : options_(options), single_(single) {
    for (const std::filesystem::path& file : files) {
      require_content(file);
      shards_.push_back(std::make_unique<Shard>(file));
      const std::vector<std::string>& names = shards_.back()->archive.names();
      for (std::size_t i = 0; i < names.size(); ++i) {
        const auto [there, is_new] = places_.try_emplace(names[i], Place{shards_.size() - 1, i});
        if (!is_new) {
          throw InputError(file.string(), "sample " + std::to_string(i),
                           "the name " + names[i] + " is also that of sample " + std::to_string(there->second.index) +
                               " in " + shards_[there->second.shard]->file);
        }
        ids_.push_back(names[i]);
      }
    }
  }

  std::vector<std::string> ids() const override { return ids_; }
  RiggedShape read(const std::string& id) const override {
    const std::string& file = shard(id).file;
    const NamedArrays sample = arrays(id);
    try {
      RiggedShape shape = shape_from_anymate(sample, id, file);
      turn_to_z_up(shape, options_.axes, Axes::kYUp);
      return shape;
    } catch (const InputError& error) {
      throw InputError(file, "sample " + id + (error.place().empty() ? "" : ", " + error.place()), error.problem());
    }
  }

  std::vector<std::filesystem::path> files(const std::string& id) const override { return {shard(id).file}; }

  std::string describe() const override {
    std::string files = shards_.size() == 1 ? shards_.front()->file : std::to_string(shards_.size()) + " files";
    return "Anymate, " + files + ": " + std::to_string(ids_.size()) + " samples";
  }

  std::string sample_id(const std::string& id) const override { return content_id(arrays(id)); }

  bool is_single_file() const override { return single_ && ids_.size() == 1; }

 private:
  struct Shard {
    explicit Shard(const std::filesystem::path& path) : file(path.string()), archive(path) {}
    std::string file;
    AnymateArchive archive;
    mutable std::mutex reading;  ///< zip archives have one position
  };
  struct Place {
    std::size_t shard, index;
  };
  const Shard& shard(const std::string& id) const {
    const auto found = places_.find(id);
    if (found == places_.end()) throw InputError(describe(), "", "has no sample \"" + id + "\"");
    return *shards_[found->second.shard];
  }
  NamedArrays arrays(const std::string& id) const {
    const Shard& holder = shard(id);
    const std::lock_guard<std::mutex> lock(holder.reading);
    return holder.archive.sample(places_.at(id).index);
  }

  SourceOptions options_;
  bool single_;
  std::vector<std::unique_ptr<Shard>> shards_;
  std::vector<std::string> ids_;
  std::map<std::string, Place> places_;
};

}  // namespace

std::unique_ptr<ShapeSource> open_anymate(const std::vector<std::filesystem::path>& files, const SourceOptions& options,
                                          bool single) {
  return std::make_unique<AnymateSource>(files, options, single);
}

}  // namespace anigen::io
