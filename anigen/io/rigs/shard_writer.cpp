#include "anigen/io/rigs/shard_writer.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/geometry/sampling.h"
#include "anigen/io/arrays/pickle_writer.h"
#include "anigen/io/arrays/zip_stream.h"
#include "anigen/io/rigs/rig_listing.h"

namespace anigen::io {

namespace {

constexpr std::size_t kSurfacePoints = 8192;

template <typename T>
NdArray plain_array(Dtype dtype, const std::vector<T>& values, std::vector<std::int64_t> shape) {
  NdArray array{dtype, std::move(shape), std::vector<std::uint8_t>(values.size() * sizeof(T))};
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(values.data());
  std::copy(bytes, bytes + array.bytes.size(), array.bytes.begin());
  return array;
}

template <typename Vector>
NdArray vectors_array(const std::vector<Vector>& vectors) {
  using Scalar = typename Vector::Scalar;
  std::vector<Scalar> values;
  for (const Vector& vector : vectors) values.insert(values.end(), vector.data(), vector.data() + vector.size());
  const std::int64_t columns = Vector::RowsAtCompileTime;
  return NdArray::from(values, {static_cast<std::int64_t>(vectors.size()), columns});
}

void require_parts(const RiggedShape& shape) {
  const char* missing = !shape.has_surface()  ? "has no mesh with faces"
                        : !shape.has_joints() ? "has no skeleton"
                        : !shape.has_skin()   ? "has no skin weights"
                                              : nullptr;
  if (missing != nullptr) throw InputError(shape.file, shape.id, missing);
}

std::pair<Eigen::Vector3d, Eigen::Vector3d> box_of(const RiggedShape& shape) {
  Eigen::Vector3d low = shape.mesh.vertices.front().cast<double>(), high = low;
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices) {
    low = low.cwiseMin(vertex.cast<double>());
    high = high.cwiseMax(vertex.cast<double>());
  }
  if (!((high - low).maxCoeff() > 0.0)) throw InputError(shape.file, shape.id, "its mesh has no extent");
  return {low, high};
}

/// Centre of the box to the origin, longest side to `side`.
void centre(RiggedShape& shape, double side) {
  const auto [low, high] = box_of(shape);
  const Eigen::Vector3d middle = 0.5 * (low + high);
  const double scale = side / (high - low).maxCoeff();
  for (Eigen::Vector3f& vertex : shape.mesh.vertices) vertex = (scale * (vertex.cast<double>() - middle)).cast<float>();
  for (Eigen::Vector3d& joint : shape.joints.positions) joint = scale * (joint - middle);
}

using PointAndNormal = Eigen::Matrix<float, 6, 1>;

std::vector<geometry::SurfacePoint> surface_points(const Mesh& mesh) {
  Rng rng(0, "points of a shard's sample");
  return geometry::sample_surface(mesh.vertices, mesh.faces, kSurfacePoints, rng);
}

/// Positions with the normals of their faces; a face without area has the normal `upward`.
std::vector<PointAndNormal> with_face_normals(const Mesh& mesh, const std::vector<geometry::SurfacePoint>& points,
                                              const Eigen::Vector3d& upward) {
  std::vector<PointAndNormal> rows;
  for (const geometry::SurfacePoint& point : points) {
    const Triangle& face = mesh.faces[at(point.face)];
    const Eigen::Vector3d a = mesh.vertices[at(face[0])].cast<double>(), b = mesh.vertices[at(face[1])].cast<double>(),
                          c = mesh.vertices[at(face[2])].cast<double>();
    const Eigen::Vector3d across = (b - a).cross(c - a);
    PointAndNormal row;
    row << position(point, mesh.vertices, mesh.faces).cast<float>(),
        (across.norm() > 0.0 ? across.normalized() : upward).cast<float>();
    rows.push_back(row);
  }
  return rows;
}

std::vector<Eigen::Vector3f> normals_of(const Mesh& mesh) {
  if (mesh.normals.size() == mesh.vertices.size()) return mesh.normals;
  return vertex_normals(mesh.vertices, mesh.faces);
}

NdArray faces_array(const std::vector<Triangle>& faces, bool wide) {
  std::vector<std::int64_t> corners;
  for (const Triangle& face : faces) corners.insert(corners.end(), face.begin(), face.end());
  const std::vector<std::int64_t> shape = {static_cast<std::int64_t>(faces.size()), 3};
  if (wide) return NdArray::from(corners, shape);
  return NdArray::from(std::vector<std::int32_t>(corners.begin(), corners.end()), shape);
}

class ArticulationXlWriter : public ShardWriter {
 public:
  ArticulationXlWriter(const std::filesystem::path& file, std::size_t count) : zip_(file), left_(count), pickle_(3) {
    zip_.begin("arr_0.npy", true);
    std::string header = "{'descr': '|O', 'fortran_order': False, 'shape': (" + std::to_string(count) + ",), }";
    constexpr std::size_t kFixed = 10, kAlign = 64;
    header.append(kAlign - (kFixed + header.size() + 1) % kAlign, ' ');
    header += '\n';
    const char length[] = {static_cast<char>(header.size() & 0xFF), static_cast<char>(header.size() >> 8)};
    zip_.write(std::string("\x93NUMPY\x01\0", 8) + std::string(length, 2) + header);
    pickle_.open_objects(count);
  }

  void add(const RiggedShape& given, const std::string& name) override {
    require_parts(given);
    if (left_ == 0) throw Error("more samples than were announced");
    RiggedShape shape = given;
    centre(shape, 1.0);
    --left_;
    pickle_.open_dict();
    add_surface(shape);
    add_skeleton(shape);
    add_skin(shape);
    pickle_.key("uuid");
    pickle_.text(name);
    pickle_.close_dict();
    zip_.write(pickle_.take());
  }

  void finish() override {
    if (left_ > 0) throw Error(std::to_string(left_) + " samples are missing of those that were announced");
    pickle_.close_objects();
    pickle_.stop();
    zip_.write(pickle_.take());
    zip_.commit();
  }

 private:
  void add_surface(const RiggedShape& shape) {
    pickle_.key("vertices");
    pickle_.array(vectors_array(in_double(shape.mesh.vertices)));
    pickle_.key("faces");
    pickle_.array(faces_array(shape.mesh.faces, true));
    pickle_.key("normals");
    pickle_.array(vectors_array(in_double(normals_of(shape.mesh))));
    // The published points are scaled by their own box, to just below 1.
    constexpr float kScale = 2 * 0.9995f;
    std::vector<Eigen::half> points;
    for (const PointAndNormal& row : with_face_normals(shape.mesh, surface_points(shape.mesh), {0, 0, 1})) {
      for (Eigen::Index k = 0; k < row.size(); ++k) points.emplace_back(k < 3 ? kScale * row[k] : row[k]);
    }
    pickle_.key("pc_w_norm");
    pickle_.array(plain_array(Dtype::kF16, points, {static_cast<std::int64_t>(kSurfacePoints), 6}));
  }

  void add_skeleton(const RiggedShape& shape) {
    std::vector<std::int64_t> bones;
    for (std::size_t j = 0; j < shape.joints.size(); ++j) {
      if (shape.joints.parents[j] < 0) continue;
      bones.push_back(shape.joints.parents[j]);
      bones.push_back(static_cast<std::int64_t>(j));
    }
    pickle_.key("joints");
    pickle_.array(vectors_array(shape.joints.positions));
    pickle_.key("bones");
    pickle_.array(NdArray::from(bones, {static_cast<std::int64_t>(bones.size() / 2), 2}));
    pickle_.key("root_index");
    pickle_.integer(first_root(shape.joints));
    std::vector<std::string> names = shape.joint_names;
    for (std::size_t j = names.size(); j < shape.joints.size(); ++j) names.push_back("joint" + std::to_string(j));
    pickle_.key("joint_names");
    pickle_.texts(names);
  }

  void add_skin(const RiggedShape& shape) {
    std::vector<double> values;
    std::vector<std::int32_t> rows, columns;
    for (std::size_t v = 0; v < shape.skin.rows(); ++v) {
      for (std::size_t i = shape.skin.offsets[v]; i < shape.skin.offsets[v + 1]; ++i) {
        values.push_back(shape.skin.influences[i].weight);
        rows.push_back(static_cast<std::int32_t>(v));
        columns.push_back(shape.skin.influences[i].joint);
      }
    }
    const std::vector<std::int64_t> length = {static_cast<std::int64_t>(values.size())};
    pickle_.key("skinning_weights_value");
    pickle_.array(NdArray::from(values, length));
    pickle_.key("skinning_weights_row");
    pickle_.array(NdArray::from(rows, length));
    pickle_.key("skinning_weights_col");
    pickle_.array(NdArray::from(columns, length));
    pickle_.key("skinning_weights_shape");
    pickle_.integers({static_cast<std::int64_t>(shape.skin.rows()), static_cast<std::int64_t>(shape.joints.size())});
  }

  ZipStream zip_;
  std::size_t left_;
  PickleWriter pickle_;
};

class AnymateWriter : public ShardWriter {
 public:
  AnymateWriter(const std::filesystem::path& file, std::size_t count) : zip_(file), left_(count), pickle_(2) {
    zip_.begin("archive/version", false);
    zip_.write("3\n");
    zip_.begin("archive/byteorder", false);
    zip_.write("little");
    pickle_.open_list();
  }

  void add(const RiggedShape& shape, const std::string& name) override {
    if (left_ == 0) throw Error("more samples than were announced");
    const NamedArrays arrays = anymate_sample(shape);
    --left_;
    pickle_.open_dict();
    pickle_.key("name");
    pickle_.text(name);
    for (const auto& [key, array] : arrays) {
      pickle_.key(key);
      if (array.shape.empty()) {
        pickle_.integer(array.as<std::int64_t>().front());
        continue;
      }
      const std::string storage = std::to_string(storages_++);
      pickle_.tensor(array, storage);
      zip_.begin("archive/data/" + storage, false);
      zip_.write({reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size()});
    }
    pickle_.close_dict();
    written_ += pickle_.take();
  }

  void finish() override {
    if (left_ > 0) throw Error(std::to_string(left_) + " samples are missing of those that were announced");
    pickle_.close_list();
    pickle_.stop();
    zip_.begin("archive/data.pkl", false);
    zip_.write(written_ + pickle_.take());
    zip_.commit();
  }

 private:
  ZipStream zip_;
  std::size_t left_, storages_ = 0;
  PickleWriter pickle_;
  std::string written_;  ///< names, shapes and numbers of storages: three kilobytes a sample
};

}  // namespace

std::unique_ptr<ShardWriter> open_shard_writer(const std::filesystem::path& file, std::size_t count) {
  const std::string extension = lower_extension(file);
  if (extension == ".npz") return std::make_unique<ArticulationXlWriter>(file, count);
  if (extension == ".pt") return std::make_unique<AnymateWriter>(file, count);
  throw NotSupportedError(file.string(), "", "shards other than .npz (Articulation-XL) and .pt (Anymate)");
}

}  // namespace anigen::io
