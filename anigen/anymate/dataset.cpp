#include "anigen/anymate/dataset.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/random.h"
#include "anigen/geometry/sampling.h"
#include "anigen/io/rigs/anymate.h"
#include "anigen/nn/init.h"
#include "anigen/rigging/voxels.h"

namespace anigen::anymate {

namespace {

constexpr float kReach = 1.25f;            // of a bone without a child to end at, in means of its weights
constexpr float kShortest = 1e-5f;         // such a bone is at least this long
constexpr float kUnweightedReach = 0.01f;  // of a bone that no point hangs on
const Eigen::Vector3f kFallback(0.0f, 0.0f, 0.001f);

struct Bones {
  std::vector<std::size_t> of_joint;  // [K] the rig's joint at the head, ascending
  std::vector<int> parents;           // [K] bone or -1
};

// Sums of each joint: Σ w and Σ w · point.
struct Held {
  std::vector<double> weight;
  std::vector<Eigen::Vector3d> moment;
};

Held held_points(std::size_t joints, const std::vector<Eigen::Vector3f>& points, const SkinWeights& skin) {
  Held held{std::vector<double>(joints, 0.0), std::vector<Eigen::Vector3d>(joints, Eigen::Vector3d::Zero())};
  for (std::size_t p = 0; p < points.size(); ++p) {
    const Influence* row = skin.row(p);
    for (std::size_t i = 0; i < skin.row_size(p); ++i) {
      const auto joint = static_cast<std::size_t>(row[i].joint);
      held.weight[joint] += row[i].weight;
      held.moment[joint] += row[i].weight * points[p].cast<double>();
    }
  }
  return held;
}

// The joint itself or its nearest ancestor that is used, -1 for none.
int used_from(const std::vector<int>& parents, const std::vector<bool>& used, int joint) {
  while (joint >= 0 && !used[static_cast<std::size_t>(joint)]) joint = parents[static_cast<std::size_t>(joint)];
  return joint;
}

// Bones that lost their root: the one nearest to the middle of their heads becomes the others' parent.
void join_orphans(const std::vector<Eigen::Vector3f>& joints, const std::vector<std::size_t>& orphans, Bones& bones) {
  const auto head = [&](std::size_t bone) -> const Eigen::Vector3f& { return joints[bones.of_joint[bone]]; };
  Eigen::Vector3f middle = Eigen::Vector3f::Zero();
  for (const std::size_t bone : orphans) middle += head(bone) / static_cast<float>(orphans.size());
  std::size_t chosen = orphans.front();
  for (const std::size_t bone : orphans) {
    if ((head(bone) - middle).norm() < (head(chosen) - middle).norm()) chosen = bone;
  }
  for (const std::size_t bone : orphans) {
    if (bone != chosen) bones.parents[bone] = static_cast<int>(chosen);
  }
}

int root_of(const std::vector<int>& parents, int joint) {
  while (parents[static_cast<std::size_t>(joint)] >= 0) joint = parents[static_cast<std::size_t>(joint)];
  return joint;
}

Bones used_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                 const std::vector<bool>& used) {
  Bones bones;
  std::vector<int> bone_at(joints.size(), -1);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!used[j]) continue;
    bone_at[j] = static_cast<int>(bones.of_joint.size());
    bones.of_joint.push_back(j);
  }
  if (bones.of_joint.empty()) throw InputError("", "skin", "nothing hangs on any joint");
  std::map<int, std::vector<std::size_t>> orphans;  // by the root that went
  for (std::size_t k = 0; k < bones.of_joint.size(); ++k) {
    const auto joint = static_cast<int>(bones.of_joint[k]);
    const int above = used_from(parents, used, parents[bones.of_joint[k]]);
    bones.parents.push_back(above < 0 ? -1 : bone_at[static_cast<std::size_t>(above)]);
    const int root = root_of(parents, joint);
    if (above < 0 && root != joint) orphans[root].push_back(k);
  }
  for (const auto& [root, children] : orphans) join_orphans(joints, children, bones);
  return bones;
}

Eigen::Vector3f skin_direction(const std::vector<Eigen::Vector3f>& joints, const Bones& bones, const Held& held,
                               std::size_t bone) {
  const std::size_t joint = bones.of_joint[bone];
  const Eigen::Vector3f& head = joints[joint];
  if (held.weight[joint] > 0.0) {
    const Eigen::Vector3f mean = (held.moment[joint] / held.weight[joint]).cast<float>();
    const Eigen::Vector3f way = kReach * (mean - head);
    return way.norm() < kShortest ? kFallback : way;
  }
  if (bones.parents[bone] < 0) return kFallback;
  const Eigen::Vector3f way = head - joints[bones.of_joint[static_cast<std::size_t>(bones.parents[bone])]];
  return way.norm() < 1e-8f ? kFallback : Eigen::Vector3f(way.normalized() * kUnweightedReach);
}

using Key = std::array<float, 3>;
Key key_of(const Eigen::Vector3f& p) { return {p.x(), p.y(), p.z()}; }

struct Tails {
  std::vector<Eigen::Vector3f> at;     // [K]
  std::vector<bool> several_children;  // [K]
};

Tails find_tails(const std::vector<Eigen::Vector3f>& joints, const Bones& bones, const Held& held) {
  const std::size_t count = bones.of_joint.size();
  std::vector<std::optional<Eigen::Vector3f>> tails(count);
  Tails found;
  found.several_children.assign(count, false);
  for (std::size_t k = 0; k < count; ++k) {
    if (bones.parents[k] < 0) continue;
    const auto parent = static_cast<std::size_t>(bones.parents[k]);
    const Eigen::Vector3f& head = joints[bones.of_joint[k]];
    if (joints[bones.of_joint[parent]] == head) continue;
    if (tails[parent])
      found.several_children[parent] = true;
    else
      tails[parent] = head;
  }
  std::map<Key, std::size_t> ends;
  for (std::size_t k = 0; k < count; ++k) {
    if (!tails[k]) tails[k] = joints[bones.of_joint[k]] + skin_direction(joints, bones, held, k);
    if (!ends.emplace(key_of(*tails[k]), k).second)
      throw InputError("", "bone " + std::to_string(k), "ends where another one ends");
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (found.several_children[k]) tails[k] = joints[bones.of_joint[k]] + skin_direction(joints, bones, held, k);
    found.at.push_back(*tails[k]);
  }
  return found;
}

constexpr int kGridSide = 64;

Eigen::Vector3d y_up(const Eigen::Vector3d& p) { return {p.x(), p.z(), -p.y()}; }
Eigen::Vector3d z_up(const Eigen::Vector3d& p) { return {p.x(), -p.z(), p.y()}; }

void require_faces(const std::vector<Triangle>& faces, std::size_t vertices) {
  if (faces.empty()) throw InputError("", "faces", "the mesh has none");
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const std::int32_t corner : faces[f]) {
      if (corner < 0 || static_cast<std::size_t>(corner) >= vertices)
        throw InputError("", "faces[" + std::to_string(f) + "]", "refers to a vertex that does not exist");
    }
  }
}

Eigen::Vector3f face_normal(const AnymateMesh& mesh, const Triangle& face) {
  const auto corner = [&](std::size_t i) -> const Eigen::Vector3f& {
    return mesh.vertices[static_cast<std::size_t>(face[i])];
  };
  const Eigen::Vector3f normal = (corner(1) - corner(0)).cross(corner(2) - corner(0));
  const float length = normal.norm();
  return length > 0.0f ? Eigen::Vector3f(normal / length) : Eigen::Vector3f::UnitY();
}

torch::Tensor empty_features(std::size_t rows) { return torch::empty({static_cast<std::int64_t>(rows), 6}); }

float* put(const Eigen::Vector3f& value, float* out) { return std::copy_n(value.data(), 3, out); }

std::vector<Eigen::Vector3f> in_frame(const std::vector<Eigen::Vector3f>& points, const AnymateFrame& frame) {
  std::vector<Eigen::Vector3f> moved;
  for (const Eigen::Vector3f& point : points) moved.emplace_back(frame.into(point.cast<double>()).cast<float>());
  return moved;
}

std::vector<bool> used_joints(const data::RiggedItem& item) {
  std::vector<bool> used(item.joints.size(), false);
  for (const Influence& influence : item.skin.influences) used[static_cast<std::size_t>(influence.joint)] = true;
  return used;
}

void put_weights(const SkinWeights& skin, const std::vector<int>& bone_of, AnymateSample& sample) {
  const auto rows = static_cast<std::int64_t>(skin.rows());
  const auto most = static_cast<std::int64_t>(std::max<std::size_t>(skin.largest_row(), 1));
  sample.skins_index = torch::full({rows, most}, -1, torch::kInt64);
  sample.skins_weight = torch::zeros({rows, most});
  auto* index = sample.skins_index.data_ptr<std::int64_t>();
  auto* weight = sample.skins_weight.data_ptr<float>();
  for (std::size_t row = 0; row < skin.rows(); ++row, index += most, weight += most) {
    for (std::size_t i = 0; i < skin.row_size(row); ++i) {
      index[i] = bone_of[static_cast<std::size_t>(skin.row(row)[i].joint)];
      weight[i] = skin.row(row)[i].weight;
    }
  }
}

AnymateSample converted(const data::RiggedItem& item, const AnymateConversion& options, std::vector<int>* bone_of) {
  const AnymateMesh mesh = anymate_mesh(item.vertices, item.faces);
  Rng rng(options.seed, "anymate points " + item.id);
  const auto points = geometry::sample_surface(mesh.vertices, mesh.faces, options.points, rng);
  const SkinWeights skin = geometry::interpolate_skin(item.skin, item.faces, points);
  std::vector<Eigen::Vector3f> positions;
  for (const geometry::SurfacePoint& point : points)
    positions.emplace_back(geometry::position(point, mesh.vertices, mesh.faces).cast<float>());
  const BoneLayout layout =
      lay_out_bones(in_frame(item.joints, mesh.frame), item.parents, used_joints(item), positions, skin);
  AnymateSample sample;
  sample.name = item.id;
  sample.points_cloud = surface_features(mesh, points);
  sample.joints = data::points_tensor(layout.joints);
  sample.conns = torch::tensor(std::vector<std::int64_t>(layout.conns.begin(), layout.conns.end()));
  sample.bones = torch::cat({data::points_tensor(layout.heads), data::points_tensor(layout.tails)}, 1);
  put_weights(skin, layout.bone_of, sample);
  if (options.cells) sample.vox = solid_cells(mesh);
  if (bone_of != nullptr) *bone_of = layout.bone_of;
  return sample;
}

// A sample with these of its points. @param rows undefined: the first `count`
AnymateSample with_points(const AnymateSample& sample, const torch::Tensor& rows, std::int64_t count) {
  AnymateSample taken = sample;
  const auto take = [&](const torch::Tensor& all) {
    if (!all.defined()) return all;
    return rows.defined() ? all.index_select(0, rows) : all.narrow(0, 0, count);
  };
  taken.points_cloud = take(sample.points_cloud);
  taken.skins_index = take(sample.skins_index);
  taken.skins_weight = take(sample.skins_weight);
  return taken;
}

using Collected = data::ConvertedAssets<AnymateSample>;

std::shared_ptr<const AnymateDataset> dataset_of(Collected all, const AnymateDatasetOptions& options,
                                                 std::uint64_t seed, const char* purpose) {
  all.report(options.skip_broken, purpose);
  return std::make_shared<const AnymateDataset>(std::move(all.samples), std::move(all.repeat), options.points, seed);
}

std::string size_problem(const AnymateSample& sample, const AnymateDatasetOptions& options) {
  const auto points = static_cast<std::size_t>(sample.points_cloud.size(0));
  if (points < options.points) return std::to_string(points) + " points, fewer than wanted";
  const std::string problem = options.problem(sample);
  if (!problem.empty()) return problem;
  if (options.cells && (!sample.vox.defined() || sample.vox.size(0) == 0)) return "no cells inside";
  return "";
}

Collected convert(const std::vector<data::AssetId>& assets, const AnymateDatasetOptions& options) {
  AnymateConversion conversion;
  conversion.points = options.points;
  conversion.cells = options.cells;
  return data::convert_assets<AnymateSample>(
      assets, [&](const data::RiggedItem& item) { return convert_rig(item, conversion); },
      [&](const AnymateSample& sample) { return size_problem(sample, options); });
}

// A sample of a released file (reference, 1.2), as it is: pc, joints, conns, bones, skins_index, skins_weight, vox.
AnymateSample read_anymate_sample(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const auto place = [&](const char* key) { return "sample " + name + ", " + key; };
  const auto read = [&](const char* key, const std::vector<std::int64_t>& shape, bool whole) {
    const io::NdArray* array = io::find(arrays, key);
    if (array == nullptr) throw InputError(file, place(key), "is missing");
    const Tensor tensor = nn::to_tensor(*array);
    bool fits = tensor.dim() == static_cast<std::int64_t>(shape.size());
    for (std::size_t axis = 0; fits && axis < shape.size(); ++axis)
      fits = shape[axis] < 0 || tensor.size(static_cast<std::int64_t>(axis)) == shape[axis];
    if (!fits) throw InputError(file, place(key), "has another shape than Anymate's files");
    if (tensor.is_floating_point() == whole)
      throw InputError(file, place(key), "has another type than Anymate's files");
    if (!whole && !tensor.isfinite().all().item<bool>()) throw InputError(file, place(key), "is not finite");
    return whole ? tensor.to(torch::kInt64) : tensor.to(torch::kFloat32);
  };
  AnymateSample sample;
  sample.name = name;
  sample.points_cloud = read("pc", {-1, 6}, false);
  sample.joints = read("joints", {-1, 3}, false);
  sample.conns = read("conns", {sample.joints.size(0)}, true);
  sample.bones = read("bones", {-1, 6}, false);
  if (io::find(arrays, "skins_index") != nullptr) {
    sample.skins_index = read("skins_index", {sample.points_cloud.size(0), -1}, true);
    sample.skins_weight = read("skins_weight", {sample.points_cloud.size(0), sample.skins_index.size(1)}, false);
  }
  if (io::find(arrays, "vox") != nullptr) sample.vox = read("vox", {-1, 3}, true);
  return sample;
}

Collected read_shards(const std::vector<std::string>& files, const AnymateDatasetOptions& options) {
  Collected all;
  for (const std::string& file : files) {
    const io::AnymateArchive archive(file);
    Progress progress("reading " + file, archive.names().size(), "samples");
    for (std::size_t i = 0; i < archive.names().size(); ++i) {
      progress.advance();
      try {
        AnymateSample sample = read_anymate_sample(archive.sample(i), archive.names()[i], file);
        const std::string problem = size_problem(sample, options);
        all.add(std::move(sample), 1, archive.names()[i], problem);
      } catch (const InputError& error) {
        all.unreadable.emplace_back(error.what());
      }
    }
    progress.finish();
  }
  return all;
}

}  // namespace

BoneLayout lay_out_bones(const std::vector<Eigen::Vector3f>& joints, const std::vector<int>& parents,
                         const std::vector<bool>& used, const std::vector<Eigen::Vector3f>& points,
                         const SkinWeights& skin) {
  const Held held = held_points(joints.size(), points, skin);
  const Bones bones = used_bones(joints, parents, used);
  const Tails tails = find_tails(joints, bones, held);

  BoneLayout layout;
  layout.tails = tails.at;
  layout.bone_of.assign(joints.size(), -1);
  std::map<Key, int> number;
  const auto joint_at = [&](const Eigen::Vector3f& position) {
    const auto [place, is_new] = number.emplace(key_of(position), static_cast<int>(layout.joints.size()));
    if (is_new) layout.joints.push_back(position);
    return place->second;
  };
  const std::size_t count = bones.of_joint.size();
  std::vector<int> head_joint(count), tail_joint(count);
  for (std::size_t k = 0; k < count; ++k) {
    layout.bone_of[bones.of_joint[k]] = static_cast<int>(k);
    layout.heads.push_back(joints[bones.of_joint[k]]);
    head_joint[k] = joint_at(layout.heads.back());
  }
  for (std::size_t k = 0; k < count; ++k) tail_joint[k] = joint_at(tails.at[k]);

  layout.conns.assign(layout.joints.size(), -1);
  for (std::size_t k = 0; k < count; ++k) {
    int& conn = layout.conns[static_cast<std::size_t>(tail_joint[k])];
    if (conn >= 0 && conn != head_joint[k])
      throw InputError("", "bone " + std::to_string(k), "ends at a joint that has another parent");
    conn = head_joint[k];
  }
  for (std::size_t k = 0; k < count; ++k) {
    if (bones.parents[k] < 0 || !tails.several_children[static_cast<std::size_t>(bones.parents[k])]) continue;
    int& conn = layout.conns[static_cast<std::size_t>(head_joint[k])];
    if (conn < 0) conn = tail_joint[static_cast<std::size_t>(bones.parents[k])];
  }
  for (std::size_t j = 0; j < layout.conns.size(); ++j) {
    if (layout.conns[j] < 0) layout.conns[j] = static_cast<int>(j);
  }
  return layout;
}

AnymateFrame AnymateFrame::of(const std::vector<Eigen::Vector3f>& vertices) {
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite()) throw InputError("", "vertices[" + std::to_string(v) + "]", "is not finite");
  }
  const Box box = bounding_box(vertices);
  if (!(box.longest_side() > 0.0)) throw InputError("", "vertices", "the mesh has no extent");
  AnymateFrame frame;
  frame.center_ = box.center();
  frame.scale_ = 2.0 / box.longest_side();
  return frame;
}

Eigen::Vector3d AnymateFrame::into(const Eigen::Vector3d& point) const { return y_up((point - center_) * scale_); }
Eigen::Vector3d AnymateFrame::out_of(const Eigen::Vector3d& point) const { return z_up(point) / scale_ + center_; }

AnymateMesh anymate_mesh(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  require_faces(faces, vertices.size());
  AnymateMesh mesh;
  mesh.frame = AnymateFrame::of(vertices);
  mesh.faces = faces;
  mesh.vertices.reserve(vertices.size());
  for (const Eigen::Vector3f& vertex : vertices)
    mesh.vertices.emplace_back(mesh.frame.into(vertex.cast<double>()).cast<float>());
  return mesh;
}

torch::Tensor surface_features(const AnymateMesh& mesh, const std::vector<geometry::SurfacePoint>& points) {
  torch::Tensor features = empty_features(points.size());
  float* out = features.data_ptr<float>();
  for (const geometry::SurfacePoint& point : points) {
    out = put(geometry::position(point, mesh.vertices, mesh.faces).cast<float>(), out);
    out = put(face_normal(mesh, mesh.faces[static_cast<std::size_t>(point.face)]), out);
  }
  return features;
}

torch::Tensor vertex_features(const AnymateMesh& mesh) {
  const std::vector<Eigen::Vector3f> normals = vertex_normals(mesh.vertices, mesh.faces);
  torch::Tensor features = empty_features(mesh.vertices.size());
  float* out = features.data_ptr<float>();
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) out = put(normals[v], put(mesh.vertices[v], out));
  return features;
}

torch::Tensor solid_cells(const AnymateMesh& mesh) {
  Mesh surface;
  surface.vertices = mesh.vertices;
  surface.faces = mesh.faces;
  const rigging::WeldedSurface welded = rigging::weld_surface(surface);
  if (!welded.has_extent) throw InputError("", "faces", "the mesh has no extent");
  // Along the longest side a cell of theirs is a cell of ours.
  const rigging::SolidVoxels solid = rigging::solid_voxels(welded, {}, kGridSide, /*validate=*/false);
  std::vector<std::int8_t> cells;
  for (int i = 0; i < kGridSide; ++i) {
    for (int j = 0; j < kGridSide; ++j) {
      for (int k = 0; k < kGridSide; ++k) {
        const Eigen::Vector3d middle =
            Eigen::Vector3d(i + 0.5, j + 0.5, k + 0.5) * (2.0 / kGridSide) - Eigen::Vector3d::Ones();
        const Eigen::Vector3d place = solid.block.measured(welded.to_unit(middle)).array().floor();
        const int x = static_cast<int>(place.x()), y = static_cast<int>(place.y()), z = static_cast<int>(place.z());
        if (!solid.block.holds(x, y, z) || !solid.is_solid(solid.block.index(x, y, z))) continue;
        for (const int index : {i, j, k}) cells.push_back(static_cast<std::int8_t>(index));
      }
    }
  }
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(cells.size() / 3), 3}, torch::kInt8);
  std::copy(cells.begin(), cells.end(), tensor.data_ptr<std::int8_t>());
  return tensor;
}

AnymateSample convert_rig(const data::RiggedItem& item, const AnymateConversion& options, std::vector<int>* bone_of) {
  return data::naming(item.id, [&] { return converted(item, options, bone_of); });
}

void RigSizes::read_sizes(ConfigReader& reader) {
  const auto size = [&](const char* key, std::size_t fallback) {
    return static_cast<std::size_t>(reader.integer(key, static_cast<std::int64_t>(fallback), 1, 4096));
  };
  min_bones = size("min_bones", min_bones);
  max_bones = size("max_bones", max_bones);
  max_joints = size("max_joints", max_joints);
}

std::string RigSizes::problem(const AnymateSample& sample) const {
  const auto joints = static_cast<std::size_t>(sample.joints.size(0));
  const auto bones = static_cast<std::size_t>(sample.bones.size(0));
  if (bones < min_bones || bones > max_bones) return std::to_string(bones) + " bones";
  return joints > max_joints ? std::to_string(joints) + " joints" : "";
}

AnymateDatasetOptions AnymateDatasetOptions::read(ConfigReader& reader) {
  AnymateDatasetOptions options;
  options.shards = reader.texts("shards", {});
  options.eval_shards = reader.texts("eval_shards", {});
  options.points = static_cast<std::size_t>(reader.integer("points", 8192, 1, 1 << 20));
  options.read_sizes(reader);
  if (options.shards.empty()) {
    options.read_common(reader);
    options.filter.drop_bad_skin = reader.boolean("filter_bad_skin", true);
  } else if (reader.has("data_dir")) {
    throw reader.error("shards", "there are files and a data_dir; give one of them");
  }
  return options;
}

AnymateDataset::AnymateDataset(std::vector<AnymateSample> samples, std::vector<std::size_t> repeat, std::size_t points,
                               std::uint64_t seed)
    : samples_(std::move(samples)), points_(points), seed_(seed) {
  for (std::size_t i = 0; i < samples_.size(); ++i) visits_.insert(visits_.end(), repeat[i], i);
}

AnymateSample AnymateDataset::sample(std::size_t index) const {
  return with_points(samples_[index], {}, static_cast<std::int64_t>(points_));
}

std::unique_ptr<data::Batch> AnymateDataset::load(const std::vector<data::Draw>& draws) const {
  auto batch = std::make_unique<AnymateDraws>();
  for (const data::Draw& draw : draws) {
    const AnymateSample& sample = samples_[visits_[draw.item]];
    const auto all = static_cast<std::size_t>(sample.points_cloud.size(0));
    torch::Tensor rows;
    if (all > points_) {
      std::vector<std::size_t> order = Rng(seed_, "anymate rows", draw.position).permutation(all);
      order.resize(points_);
      rows = torch::tensor(std::vector<std::int64_t>(order.begin(), order.end()));
    }
    batch->samples.push_back(with_points(sample, rows, static_cast<std::int64_t>(points_)));
    batch->ids.push_back(sample.name);
  }
  return batch;
}

AnymateDatasets open_anymate(const AnymateDatasetOptions& options, std::uint64_t seed) {
  AnymateDatasets sets;
  const auto train = [&](Collected all) { sets.train = dataset_of(std::move(all), options, seed, "train on"); };
  const auto hold_out = [&](Collected all) { sets.held_out = dataset_of(std::move(all), options, seed, "hold out"); };
  if (!options.shards.empty()) {
    train(read_shards(options.shards, options));
    if (!options.eval_shards.empty()) hold_out(read_shards(options.eval_shards, options));
    return sets;
  }
  const data::TrainAndEval assets = data::select(options);
  data::refuse_test_creatures(assets, options);
  train(convert(assets.train, options));
  if (!assets.eval.empty()) hold_out(convert(assets.eval, options));
  return sets;
}

}  // namespace anigen::anymate
