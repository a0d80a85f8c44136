#include "anigen/io/rigs/rigged_shape.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::io {

RiggedShape rigged_shape(Asset asset, const std::string& id, const std::string& file) {
  RiggedShape shape(id, file);
  shape.joints = anigen::joint_tree(asset.skeleton);
  shape.joint_names = asset.skeleton.names;
  if (!asset.animations.empty())
    shape.clips = std::make_shared<RigClips>(RigClips{std::move(asset.skeleton), std::move(asset.animations)});
  shape.mesh = std::move(asset.mesh);
  shape.materials = std::move(asset.materials);
  shape.images = std::move(asset.images);
  shape.skin = std::move(asset.skin);
  return shape;
}

Asset to_asset(const RiggedShape& shape) {
  anigen::check(shape.joints, shape.file);
  const anigen::JointTree tree = anigen::connected(shape.joints);
  const std::vector<int> order = anigen::parents_first(tree);
  std::vector<int> place(tree.size());
  for (std::size_t i = 0; i < order.size(); ++i) place[at(order[i])] = static_cast<int>(i);

  std::vector<Eigen::Vector3d> positions;
  std::vector<int> parents;
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const int j : order) {
    const auto joint = static_cast<std::size_t>(j);
    positions.push_back(tree.positions[joint]);
    parents.push_back(tree.parents[joint] < 0 ? -1 : place[at(tree.parents[joint])]);
    std::string name = joint < shape.joint_names.size() ? shape.joint_names[joint] : "";
    for (std::size_t k = joint; name.empty() || !taken.insert(name).second; k += tree.size())
      name = "joint_" + std::to_string(k);
    names.push_back(std::move(name));
  }
  Asset asset;
  asset.name = shape.id;
  asset.mesh = shape.mesh;
  asset.materials = shape.materials;
  asset.images = shape.images;
  asset.skeleton = skeleton_from_joints(positions, parents, names);
  if (!shape.mesh.vertices.empty()) asset.skin = shape.skin;
  for (Influence& influence : asset.skin.influences)
    influence.joint = static_cast<std::int32_t>(place[at(influence.joint)]);
  return asset;
}

namespace {

/// (x, y, z) → (x, -sign · z, sign · y): a quarter turn about x.
template <typename Vector>
void turn(std::vector<Vector>& vectors, int sign) {
  for (Vector& v : vectors) v = Vector(v.x(), -sign * v.z(), sign * v.y());
}

void turn(RiggedShape& shape, int sign) {
  turn(shape.mesh.vertices, sign);
  turn(shape.mesh.normals, sign);
  turn(shape.joints.positions, sign);
  Eigen::Matrix3d quarter;
  quarter << 1, 0, 0, 0, 0, -sign, 0, sign, 0;
  shape.clips_turn = quarter * shape.clips_turn;
}

}  // namespace

Axes parse_axes(const std::string& word) {
  for (const Axes axes : {Axes::kFormat, Axes::kYUp, Axes::kZUp}) {
    if (word == name_of(axes)) return axes;
  }
  throw InputError("", "axes", "\"" + word + "\" is none of format, y-up, z-up");
}

const char* name_of(Axes axes) {
  static constexpr const char* kNames[] = {"format", "y-up", "z-up"};
  return kNames[static_cast<int>(axes)];
}

void from_y_up(RiggedShape& shape) { turn(shape, 1); }
void to_y_up(RiggedShape& shape) { turn(shape, -1); }

void turn_to_z_up(RiggedShape& shape, Axes wanted, Axes format) {
  if ((wanted == Axes::kFormat ? format : wanted) == Axes::kYUp) from_y_up(shape);
}

namespace {

std::string shape_text(const std::vector<std::int64_t>& shape) {
  return "[" + joined(shape, ", ", [](auto size) { return size < 0 ? "any" : std::to_string(size); }) + "]";
}

}  // namespace

std::string ArrayFields::first_of(const std::vector<std::string>& names) const {
  for (const std::string& name : names) {
    if (has(name)) return name;
  }
  return "";
}

const NdArray& ArrayFields::array(const std::string& name, const std::vector<std::int64_t>& shape) const {
  const NdArray& found = array(name);
  const bool fits = std::equal(found.shape.begin(), found.shape.end(), shape.begin(), shape.end(),
                               [](std::int64_t size, std::int64_t wanted) { return wanted < 0 || size == wanted; });
  if (!fits) fail(name, "its shape is " + shape_text(found.shape) + ", expected " + shape_text(shape));
  return found;
}

template <typename Vector>
std::vector<Vector> ArrayFields::unchecked_points(const std::string& name, std::size_t first) const {
  const NdArray& found = array(name, {-1, -1});
  if (found.shape[0] == 0) return {};  // some writers make [0, 0] of an empty list
  const auto width = static_cast<std::size_t>(found.shape[1]);
  if (width < first + 3) return {};
  const auto values = found.as<typename Vector::Scalar>();
  std::vector<Vector> points(values.size() / width);
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t k = 0; k < 3; ++k) points[i][static_cast<Eigen::Index>(k)] = values[i * width + first + k];
  }
  return points;
}

template <typename Vector>
std::vector<Vector> ArrayFields::points(const std::string& name, std::size_t first) const {
  std::vector<Vector> points = unchecked_points<Vector>(name, first);
  if (points.empty() && rows(name) > 0) {
    const std::int64_t width = array(name, {-1, -1}).shape[1];
    fail(name, "has " + std::to_string(width) + " columns, expected at least " + std::to_string(first + 3));
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!points[i].allFinite()) fail(name + "[" + std::to_string(i) + "]", "is not finite");
  }
  return points;
}

template std::vector<Eigen::Vector3f> ArrayFields::unchecked_points(const std::string&, std::size_t) const;
template std::vector<Eigen::Vector3f> ArrayFields::points(const std::string&, std::size_t) const;
template std::vector<Eigen::Vector3d> ArrayFields::points(const std::string&, std::size_t) const;

std::vector<std::int32_t> ArrayFields::integers(const std::string& name, const std::vector<std::int64_t>& shape) const {
  const NdArray& found = array(name, shape);
  try {
    return found.as<std::int32_t>();
  } catch (const Error& error) {  // it does not know which file it is
    fail(name, error.what());
  }
}

std::int32_t ArrayFields::integer(const std::string& name) const {
  if (array(name).count() != 1) fail(name, "expected one number");
  return integers(name, array(name).shape)[0];
}

std::vector<Triangle> ArrayFields::triangles(const std::string& name, std::size_t vertices) const {
  if (rows(name) == 0) return {};
  const std::vector<std::int32_t> corners = integers(name, {-1, 3});
  std::vector<Triangle> faces(corners.size() / 3);
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] < 0 || static_cast<std::size_t>(corners[i]) >= vertices) {
      fail(name + "[" + std::to_string(i / 3) + "]",
           "names vertex " + std::to_string(corners[i]) + " of " + std::to_string(vertices));
    }
    faces[i / 3][i % 3] = corners[i];
  }
  return faces;
}

void SkinRows::add(std::int64_t vertex, std::int64_t joint, float weight, const std::string& place) {
  if (vertex < 0 || static_cast<std::size_t>(vertex) >= rows_.size())
    throw InputError(file_, place, "weights vertex " + std::to_string(vertex) + " of " + std::to_string(rows_.size()));
  if (joint < 0 || static_cast<std::size_t>(joint) >= joints_)
    throw InputError(file_, place, "weights joint " + std::to_string(joint) + " of " + std::to_string(joints_));
  if (!std::isfinite(weight)) throw InputError(file_, place, "a weight is not finite");
  if (weight < 0.0f) ++negative_;
  if (weight > 0.0f) rows_[at(vertex)].push_back({static_cast<std::int32_t>(joint), weight});
}

void SkinRows::finish(std::int32_t fallback, RiggedShape& shape) {
  constexpr double kRounding = 0.01;
  shape.skin = {};
  shape.unweighted = 0;
  shape.lowest_weight_sum = 1.0;
  shape.not_whole.clear();
  std::size_t rescaled = 0;
  for (std::vector<Influence>& row : rows_) {
    double sum = 0.0;
    for (const Influence& i : row) sum += i.weight;
    if (std::abs(sum - 1.0) > kRounding) shape.not_whole.push_back(shape.skin.rows());
    if (row.empty()) {
      ++shape.unweighted;
      row.push_back({fallback, 1.0f});
    } else {
      shape.lowest_weight_sum = std::min(shape.lowest_weight_sum, sum);
      if (std::abs(sum - 1.0) > kRounding) ++rescaled;
    }
    shape.skin.append_row(std::move(row));
  }
  rows_.clear();
  const auto tell = [&shape](std::size_t count, const std::string& what) {
    if (count > 0) shape.notes.push_back(std::to_string(count) + what);
  };
  tell(shape.unweighted, " vertices without a weight are bound to joint " + std::to_string(fallback));
  tell(rescaled, " vertices' weights did not sum to 1 and were divided by their sum");
  tell(negative_, " negative weights were left out");
}

namespace {

std::size_t repeated_places(std::vector<Eigen::Vector3d> places) {
  const auto less = [](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  };
  std::sort(places.begin(), places.end(), less);
  return static_cast<std::size_t>(places.end() - std::unique(places.begin(), places.end()));
}

}  // namespace

std::int32_t first_root(const anigen::JointTree& tree) {
  const std::vector<int> all = anigen::roots(tree);
  return all.empty() ? 0 : all.front();
}

void set_dense_skin(const ArrayFields& fields, const std::string& name, RiggedShape& shape) {
  const std::size_t vertices = shape.mesh.vertices.size(), joints = shape.joints.size();
  const std::vector<float> weights =
      fields.reals(name, {static_cast<std::int64_t>(vertices), static_cast<std::int64_t>(joints)});
  SkinRows rows(vertices, joints, fields.file());
  for (std::size_t i = 0; i < weights.size(); ++i) {
    if (weights[i] == 0.0f) continue;
    const std::size_t v = i / joints, j = i % joints;
    rows.add(static_cast<std::int64_t>(v), static_cast<std::int64_t>(j), weights[i], name);
  }
  rows.finish(first_root(shape.joints), shape);
}

void set_normals(RiggedShape& shape, std::vector<Eigen::Vector3f> normals) {
  Mesh& mesh = shape.mesh;
  if (normals.empty()) return;
  if (normals.size() != mesh.vertices.size()) {
    shape.notes.push_back(std::to_string(normals.size()) + " normals for " + std::to_string(mesh.vertices.size()) +
                          " vertices were left out");
    return;
  }
  std::vector<Eigen::Vector3f> computed;
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const float length = normals[v].stableNorm();
    if (length > 0.0f && normals[v].allFinite() && std::isfinite(length)) {
      normals[v] /= length;
      continue;
    }
    if (computed.empty()) computed = vertex_normals(mesh.vertices, mesh.faces);
    normals[v] = computed[v];
  }
  mesh.normals = std::move(normals);
}

RiggedShape shape_with_mesh(const ArrayFields& fields, const std::string& normals_name, const std::string& id,
                            const std::string& file) {
  RiggedShape shape(id, file);
  if (!fields.has("vertices")) return shape;
  shape.mesh.vertices = fields.points("vertices");
  if (fields.has("faces")) shape.mesh.faces = fields.triangles("faces", shape.mesh.vertices.size());
  if (fields.has(normals_name)) set_normals(shape, fields.unchecked_points(normals_name, 0));
  return shape;
}

void note_missing_parts(RiggedShape& shape) {
  if (shape.mesh.vertices.empty())
    shape.notes.push_back("no mesh: surface and skin metrics are not computed");
  else if (!shape.has_surface())
    shape.notes.push_back("no faces: the mesh is a point set");
  if (!shape.has_joints()) {
    shape.notes.push_back("no skeleton: skeleton and skin metrics are not computed");
    return;
  }
  const std::size_t repeated = repeated_places(shape.joints.positions);
  if (repeated > 0) shape.notes.push_back(std::to_string(repeated) + " joints lie exactly where another one does");
  const std::size_t trees = anigen::roots(shape.joints).size();
  if (trees > 1) shape.notes.push_back("a forest of " + std::to_string(trees) + " trees");
  if (!shape.mesh.vertices.empty() && !shape.has_skin())
    shape.notes.push_back("no skin weights: skin metrics are not computed");
}

RiggedShape read_scene_shape(const std::filesystem::path& file, const std::string& id, Axes axes, bool require_rig) {
  const std::string extension = lower_extension(file);
  const bool is_gltf = extension == ".glb" || extension == ".gltf" || extension == ".vrm";
  ImportOptions options;
  options.require_rig = require_rig;
  ImportedAsset imported = is_gltf ? read_gltf(file, options) : read_assimp(file, options);
  RiggedShape shape = rigged_shape(std::move(imported.asset), id, file.string());
  shape.lowest_weight_sum = imported.lowest_weight_sum;
  if (shape.has_joints()) anigen::check(shape.joints, shape.file);
  for (const ImportNote& note : imported.notes) shape.notes.push_back(note.code + ": " + note.message);
  if (axes == Axes::kZUp) to_y_up(shape);
  note_missing_parts(shape);
  return shape;
}

}  // namespace anigen::io
