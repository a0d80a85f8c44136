#include <algorithm>
#include <limits>
#include <map>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/sampling.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/io/rigs/shard_writer.h"

namespace anigen::io {

namespace {

constexpr std::size_t kCloud = 8192;
constexpr double kTiny = 0.001;  // length of a tail that nothing says the direction of

/// Bones with tails, joints and links of a skeleton in the layout of a sample (docs/reference/anymate.md, 1.5).
class AnymateLayout {
 public:
  /// @param points of the surface, with one row of weights each
  AnymateLayout(const RiggedShape& shape, const std::vector<Eigen::Vector3d>& points, const SkinWeights& skin)
      : shape_(shape), heads_(shape.joints.positions), children_(heads_.size()), tails_(heads_.size()) {
    for (std::size_t j = 0; j < heads_.size(); ++j) {
      if (parent(j) >= 0) children_[at(parent(j))].push_back(j);
    }
    gather(points, skin);
    for (std::size_t b = 0; b < heads_.size(); ++b) {
      const bool only_child = children_[b].size() == 1 && heads_[children_[b].front()] != heads_[b];
      tails_[b] = only_child ? heads_[children_[b].front()] : heads_[b] + along_skin(b);
    }
    link();
  }

  std::vector<Eigen::Vector3d> joints;
  std::vector<int> parents;  ///< a root's is itself
  const std::vector<Eigen::Vector3d>& tails() const { return tails_; }

 private:
  int parent(std::size_t joint) const { return shape_.joints.parents[joint]; }

  /// Weighted mean of (points − head) of every bone.
  void gather(const std::vector<Eigen::Vector3d>& points, const SkinWeights& skin) {
    sums_.assign(heads_.size(), Eigen::Vector3d::Zero());
    masses_.assign(heads_.size(), 0.0);
    for (std::size_t p = 0; p < points.size(); ++p) {
      for (std::size_t i = skin.offsets[p]; i < skin.offsets[p + 1]; ++i) {
        const std::size_t bone = at(skin.influences[i].joint);
        sums_[bone] += double{skin.influences[i].weight} * (points[p] - heads_[bone]);
        masses_[bone] += double{skin.influences[i].weight};
      }
    }
  }

  Eigen::Vector3d along_skin(std::size_t bone) const {
    constexpr double kBeyond = 1.25, kShortest = 1e-5, kUnmoved = 0.01, kNoBone = 1e-8;
    const Eigen::Vector3d up(0, 0, kTiny);
    if (masses_[bone] > 0.0) {
      const Eigen::Vector3d direction = kBeyond * sums_[bone] / masses_[bone];
      return direction.norm() < kShortest ? up : direction;
    }
    if (parent(bone) < 0) return up;
    const Eigen::Vector3d from_parent = heads_[bone] - heads_[at(parent(bone))];
    return from_parent.norm() < kNoBone ? up : Eigen::Vector3d(kUnmoved * from_parent.normalized());
  }

  /// The joint at this place, new where there was none.
  int joint_at(const Eigen::Vector3d& place) {
    const auto key = std::tuple(place.x(), place.y(), place.z());
    const auto [there, is_new] = places_.try_emplace(key, static_cast<int>(joints.size()));
    if (is_new) joints.push_back(place);
    return there->second;
  }

  void link() {
    for (std::size_t b = 0; b < heads_.size(); ++b) {
      if (at(joint_at(heads_[b])) != b) throw InputError(shape_.file, shape_.id, "two of its joints are in one place");
    }
    std::vector<int> ends;
    for (const Eigen::Vector3d& tail : tails_) ends.push_back(joint_at(tail));
    parents.resize(joints.size());
    for (std::size_t i = 0; i < joints.size(); ++i) parents[i] = static_cast<int>(i);
    for (std::size_t b = 0; b < heads_.size(); ++b) {
      const std::size_t end = at(ends[b]);
      if (parents[end] != ends[b]) throw InputError(shape_.file, shape_.id, "two of its bones end in one place");
      parents[end] = static_cast<int>(b);
    }
    // Children of a bone whose tail is elsewhere hang on that tail, by links that are no bones.
    for (std::size_t j = 0; j < heads_.size(); ++j) {
      if (parent(j) >= 0 && parents[j] == static_cast<int>(j)) parents[j] = ends[at(parent(j))];
    }
  }

  const RiggedShape& shape_;
  const std::vector<Eigen::Vector3d>& heads_;
  std::vector<std::vector<std::size_t>> children_;
  std::vector<Eigen::Vector3d> tails_, sums_;
  std::vector<double> masses_;
  std::map<std::tuple<double, double, double>, int> places_;
};

/// Longest side 2, x and z centred, y as far above 0 as below for the points (1.3, without their draw in the height).
void to_anymate_frame(RiggedShape& shape) {
  to_y_up(shape);
  Eigen::Vector3f low = shape.mesh.vertices.front(), high = low;
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices) {
    low = low.cwiseMin(vertex);
    high = high.cwiseMax(vertex);
  }
  const double side = double{(high - low).maxCoeff()};
  if (!(side > 0.0)) throw InputError(shape.file, shape.id, "its mesh has no extent");
  const Eigen::Vector3d middle = 0.5 * (low + high).cast<double>();
  for (Eigen::Vector3f& vertex : shape.mesh.vertices)
    vertex = (2.0 / side * (vertex.cast<double>() - middle)).cast<float>();
  // Files hold single precision: links go by places that are equal.
  for (Eigen::Vector3d& joint : shape.joints.positions)
    joint = (2.0 / side * (joint - middle)).cast<float>().cast<double>();
}

NdArray rows_of_six(const std::vector<Eigen::Vector3f>& first, const std::vector<Eigen::Vector3f>& second) {
  std::vector<float> values;
  for (std::size_t i = 0; i < first.size(); ++i) {
    values.insert(values.end(), first[i].data(), first[i].data() + 3);
    values.insert(values.end(), second[i].data(), second[i].data() + 3);
  }
  return NdArray::from(values, {static_cast<std::int64_t>(first.size()), 6});
}

template <typename T>
NdArray bytes_as(Dtype dtype, const std::vector<T>& values, std::vector<std::int64_t> shape) {
  NdArray array{dtype, std::move(shape), std::vector<std::uint8_t>(values.size() * sizeof(T))};
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(values.data());
  std::copy(bytes, bytes + array.bytes.size(), array.bytes.begin());
  return array;
}

/// Bones and weights of each row, padded with −1 and 0.
void add_skin_pairs(const std::string& name, const SkinWeights& skin, NamedArrays& arrays) {
  std::size_t width = 1;
  for (std::size_t v = 0; v < skin.rows(); ++v) width = std::max(width, skin.offsets[v + 1] - skin.offsets[v]);
  std::vector<std::int8_t> bones(skin.rows() * width, -1);
  std::vector<Eigen::half> weights(skin.rows() * width, Eigen::half(0.0f));
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    for (std::size_t i = skin.offsets[v]; i < skin.offsets[v + 1]; ++i) {
      const std::size_t place = v * width + i - skin.offsets[v];
      bones[place] = static_cast<std::int8_t>(skin.influences[i].joint);
      weights[place] = Eigen::half(skin.influences[i].weight);
    }
  }
  const std::vector<std::int64_t> shape = {static_cast<std::int64_t>(skin.rows()), static_cast<std::int64_t>(width)};
  arrays.emplace_back(name + "_index", bytes_as(Dtype::kI8, bones, shape));
  arrays.emplace_back(name + "_weight", bytes_as(Dtype::kF16, weights, shape));
}

/// Cells of 64³ that the surface meets.
NdArray surface_cells(const Mesh& mesh) {
  constexpr int kCells = 64;
  std::vector<Eigen::Vector3f> halved;
  for (const Eigen::Vector3f& vertex : mesh.vertices) halved.push_back(0.5f * vertex);
  std::vector<std::int8_t> cells;
  for (const geometry::Voxel& voxel : geometry::voxelize_surface(halved, mesh.faces, kCells)) {
    for (const std::int32_t index : voxel) cells.push_back(static_cast<std::int8_t>(index));
  }
  const auto count = static_cast<std::int64_t>(cells.size() / 3);
  return bytes_as(Dtype::kI8, cells, {count, 3});
}

}  // namespace

NamedArrays anymate_sample(const RiggedShape& given) {
  if (!given.has_surface()) throw InputError(given.file, given.id, "has no mesh with faces");
  if (!given.has_skin()) throw InputError(given.file, given.id, "has no skeleton with skin weights");
  constexpr std::size_t kMost = std::numeric_limits<std::int8_t>::max();
  RiggedShape shape = given;
  to_anymate_frame(shape);
  Rng rng(0, "points of an Anymate sample");
  const Mesh& mesh = shape.mesh;
  const std::vector<geometry::SurfacePoint> places = geometry::sample_surface(mesh.vertices, mesh.faces, kCloud, rng);
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector3f> cloud, face_normals;
  for (const geometry::SurfacePoint& place : places) {
    points.push_back(position(place, mesh.vertices, mesh.faces));
    cloud.push_back(points.back().cast<float>());
    const Triangle& face = mesh.faces[at(place.face)];
    const Eigen::Vector3f& a = mesh.vertices[at(face[0])];
    const Eigen::Vector3f across = (mesh.vertices[at(face[1])] - a).cross(mesh.vertices[at(face[2])] - a);
    face_normals.push_back(across.norm() > 0.0f ? across.normalized() : Eigen::Vector3f::UnitY());
  }
  const SkinWeights skin = geometry::interpolate_skin(shape.skin, mesh.faces, places);
  const AnymateLayout layout(shape, points, skin);
  if (layout.joints.size() > kMost)
    throw InputError(given.file, given.id,
                     "has " + std::to_string(layout.joints.size()) +
                         " joints with its tails, and Anymate's files hold " + std::to_string(kMost));

  std::vector<Eigen::Vector3f> heads, tails, joints;
  for (const Eigen::Vector3d& head : shape.joints.positions) heads.push_back(head.cast<float>());
  for (const Eigen::Vector3d& tail : layout.tails()) tails.push_back(tail.cast<float>());
  std::vector<float> places_of_joints;
  for (const Eigen::Vector3d& joint : layout.joints) {
    const Eigen::Vector3f single = joint.cast<float>();
    places_of_joints.insert(places_of_joints.end(), single.data(), single.data() + 3);
  }
  const auto count = static_cast<std::int64_t>(layout.joints.size());
  const std::vector<std::int8_t> links(layout.parents.begin(), layout.parents.end());
  NamedArrays arrays;
  arrays.emplace_back("pc", rows_of_six(cloud, face_normals));
  arrays.emplace_back("vox", surface_cells(mesh));
  arrays.emplace_back("joints", NdArray::from(places_of_joints, {count, 3}));
  arrays.emplace_back("joints_num", NdArray::from<std::int64_t>({count}, {}));
  arrays.emplace_back("conns", bytes_as(Dtype::kI8, links, {count}));
  arrays.emplace_back("bones", rows_of_six(heads, tails));
  arrays.emplace_back("bones_num", NdArray::from<std::int64_t>({static_cast<std::int64_t>(heads.size())}, {}));
  add_skin_pairs("skins", skin, arrays);
  arrays.emplace_back("mesh_pc", rows_of_six(mesh.vertices, vertex_normals(mesh.vertices, mesh.faces)));
  std::vector<std::int32_t> corners;
  for (const Triangle& face : mesh.faces) corners.insert(corners.end(), face.begin(), face.end());
  arrays.emplace_back("mesh_face", NdArray::from(corners, {static_cast<std::int64_t>(mesh.faces.size()), 3}));
  add_skin_pairs("mesh_skins", shape.skin, arrays);
  return arrays;
}

}  // namespace anigen::io
