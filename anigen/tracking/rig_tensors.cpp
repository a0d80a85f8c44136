#include "anigen/tracking/rig_tensors.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/geometry/simplify.h"
#include "anigen/render/surface_color.h"

namespace anigen::tracking {

namespace {

constexpr std::int64_t kSurfacePoints = 1000;
constexpr double kLeastSkin = 1e-3;  // of all weights: what fewer hang on cannot be seen to turn

const torch::TensorOptions kReal = torch::TensorOptions(torch::kFloat64);

using RowMatrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Eigen::Map<RowMatrix3> matrix_at(double* data) { return Eigen::Map<RowMatrix3>(data); }
Eigen::Map<const RowMatrix3> matrix_at(const double* data) { return Eigen::Map<const RowMatrix3>(data); }

/// Linear base colour per vertex: that of the last face around it, of which a file's vertex has one material.
std::vector<Eigen::Vector3f> base_colors(const Asset& asset) {
  const Mesh& mesh = asset.mesh;
  std::vector<std::unique_ptr<render::Texture>> textures(asset.images.size());
  std::vector<Eigen::Vector3f> colors(mesh.vertices.size(), Eigen::Vector3f::Ones());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const int number = mesh.face_materials.empty() ? -1 : mesh.face_materials[f];
    const Material* material = number < 0 ? nullptr : &asset.materials[static_cast<std::size_t>(number)];
    for (const std::int32_t corner : mesh.faces[f]) {
      const auto v = static_cast<std::size_t>(corner);
      Eigen::Vector3f color = Eigen::Vector3f::Ones();
      if (material != nullptr) color = material->base_color.head<3>();
      if (material != nullptr && material->image >= 0 && !mesh.uvs.empty()) {
        auto& texture = textures[static_cast<std::size_t>(material->image)];
        if (!texture) {
          texture =
              std::make_unique<render::Texture>(asset.images[static_cast<std::size_t>(material->image)], asset.name);
        }
        color = color.cwiseProduct(texture->lookup(mesh.uvs[v]));
      }
      if (!mesh.colors.empty()) color = color.cwiseProduct(mesh.colors[v].head<3>());
      colors[v] = color.cwiseMax(0.0f).cwiseMin(1.0f);
    }
  }
  return colors;
}

/// Geometry with one vertex per place and row of weights.
struct Welded {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;
  SkinWeights skin;
  std::vector<std::int64_t> vertex_of;  // [C]
};

Welded welded(const Asset& asset) {
  Welded result;
  using Key = std::pair<std::array<float, 3>, std::vector<std::pair<std::int32_t, float>>>;
  std::map<Key, std::int64_t> known;
  for (std::size_t v = 0; v < asset.mesh.vertices.size(); ++v) {
    const Eigen::Vector3f& p = asset.mesh.vertices[v];
    Key key{{p.x(), p.y(), p.z()}, {}};
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i)
      key.second.emplace_back(asset.skin.row(v)[i].joint, asset.skin.row(v)[i].weight);
    const auto [at, is_new] = known.emplace(std::move(key), static_cast<std::int64_t>(result.vertices.size()));
    if (is_new) {
      result.vertices.push_back(p);
      result.skin.append_copy(asset.skin, v);
    }
    result.vertex_of.push_back(at->second);
  }
  for (const Triangle& face : asset.mesh.faces) {
    Triangle moved{};
    for (std::size_t k = 0; k < 3; ++k)
      moved[k] = static_cast<std::int32_t>(result.vertex_of[static_cast<std::size_t>(face[k])]);
    result.faces.push_back(moved);
  }
  return result;
}

Tensor points_tensor(const std::vector<Eigen::Vector3f>& points) {
  const Tensor tensor = torch::empty({static_cast<std::int64_t>(points.size()), 3}, kReal);
  double* to = tensor.data_ptr<double>();
  for (const Eigen::Vector3f& point : points) {
    for (Eigen::Index k = 0; k < 3; ++k) *to++ = static_cast<double>(point[k]);
  }
  return tensor;
}

Tensor faces_tensor(const std::vector<Triangle>& faces) {
  const Tensor tensor = torch::empty({static_cast<std::int64_t>(faces.size()), 3}, torch::kInt64);
  std::int64_t* to = tensor.data_ptr<std::int64_t>();
  for (const Triangle& face : faces) {
    for (const std::int32_t v : face) *to++ = v;
  }
  return tensor;
}

Tensor dense_skin(const SkinWeights& skin, std::int64_t joints) {
  const Tensor tensor = torch::zeros({static_cast<std::int64_t>(skin.rows()), joints}, kReal);
  double* to = tensor.data_ptr<double>();
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    for (std::size_t i = 0; i < skin.row_size(v); ++i)
      to[static_cast<std::int64_t>(v) * joints + skin.row(v)[i].joint] = static_cast<double>(skin.row(v)[i].weight);
  }
  return tensor;
}

void set_surface(const Asset& asset, RigTensors& rig) {
  Mesh colored = asset.mesh;
  colored.colors.clear();
  for (const Eigen::Vector3f& color : base_colors(asset))
    colored.colors.emplace_back(color.x(), color.y(), color.z(), 1);
  if (colored.normals.empty()) colored.normals = vertex_normals(colored.vertices, colored.faces);
  Welded joined = welded(asset);
  if (joined.vertices.size() > kMostVertices) {
    const std::size_t faces = std::max<std::size_t>(4, joined.faces.size() * kMostVertices / joined.vertices.size());
    geometry::Simplified simple = geometry::simplify(joined.vertices, joined.faces, faces);
    geometry::TransferredAttributes carried = geometry::transfer_attributes(colored, asset.skin, simple.mesh.vertices);
    colored = std::move(simple.mesh);
    colored.colors = std::move(carried.colors);
    colored.normals = vertex_normals(colored.vertices, colored.faces);
    joined = {colored.vertices, colored.faces, std::move(carried.skin), {}};
    for (std::size_t v = 0; v < colored.vertices.size(); ++v) joined.vertex_of.push_back(static_cast<std::int64_t>(v));
  }
  rig.vertices = points_tensor(joined.vertices);
  rig.faces = faces_tensor(joined.faces);
  rig.skin = dense_skin(joined.skin, rig.joints());
  std::vector<Eigen::Vector3f> colors;
  for (const Eigen::Vector4f& color : colored.colors) colors.emplace_back(color.head<3>());
  rig.colors = points_tensor(colors);
  rig.normals = points_tensor(colored.normals);
  rig.color_faces = faces_tensor(colored.faces);
  rig.color_vertex = torch::tensor(joined.vertex_of, torch::kInt64);
}

/// Points spread over the faces by area: one at a random place in each of as many equal parts of the surface.
void set_samples(RigTensors& rig) {
  const std::int64_t faces = rig.faces.size(0);
  const auto corner = [&](std::int64_t k) { return rig.vertices.index_select(0, rig.faces.select(1, k)); };
  const Tensor area = torch::cross(corner(1) - corner(0), corner(2) - corner(0), 1).norm(2, 1).contiguous();
  const double total = area.sum().item<double>();
  if (!(total > 0.0)) throw InputError("", "mesh", "its faces have no area");
  rig.sample_faces = torch::empty({kSurfacePoints}, torch::kInt64);
  rig.sample_weights = torch::empty({kSurfacePoints, 3}, kReal);
  Rng rng(0, "tracking samples", 0);
  std::int64_t face = 0;
  double before = 0.0;  // area of the faces before it
  for (std::int64_t i = 0; i < kSurfacePoints; ++i) {
    const double wanted = total * (static_cast<double>(i) + rng.uniform()) / static_cast<double>(kSurfacePoints);
    while (face + 1 < faces && before + area.data_ptr<double>()[face] < wanted)
      before += area.data_ptr<double>()[face++];
    double u = rng.uniform(), v = rng.uniform();
    if (u + v > 1.0) u = 1.0 - u, v = 1.0 - v;
    rig.sample_faces.data_ptr<std::int64_t>()[i] = face;
    double* weights = rig.sample_weights.data_ptr<double>() + 3 * i;
    weights[0] = 1.0 - u - v, weights[1] = u, weights[2] = v;
  }
}

/// Towards the mean of the joints that hang on a joint, or, at the end of a chain, of the vertices that follow it.
void set_axes(const Skeleton& skeleton, RigTensors& rig) {
  const std::size_t count = skeleton.size();
  std::vector<Eigen::Vector3d> sum(count, Eigen::Vector3d::Zero()), followers(count, Eigen::Vector3d::Zero());
  std::vector<double> carried(count, 0.0);
  const double* skin = rig.skin.data_ptr<double>();
  const double* points = rig.vertices.data_ptr<double>();
  const std::vector<Eigen::Vector3d> places = skeleton.positions();
  for (std::int64_t v = 0; v < rig.vertices.size(0); ++v) {
    const Eigen::Vector3d p(points[3 * v], points[3 * v + 1], points[3 * v + 2]);
    for (std::size_t j = 0; j < count; ++j) {
      const double weight = skin[v * static_cast<std::int64_t>(count) + static_cast<std::int64_t>(j)];
      if (weight == 0.0) continue;
      followers[j] += weight * (p - places[j]);
      carried[j] += weight;
    }
  }
  for (std::size_t j = 1; j < count; ++j) {
    const auto parent = static_cast<std::size_t>(skeleton.parents[j]);
    sum[parent] += places[j] - places[parent];
  }
  rig.bone_axis = torch::zeros({rig.joints(), 3}, kReal);
  rig.is_free = torch::zeros({rig.joints(), 1}, kReal);
  std::vector<double> below = carried;
  for (std::size_t j = count; j-- > 1;) below[static_cast<std::size_t>(skeleton.parents[j])] += below[j];
  for (std::size_t j = 0; j < count; ++j) {
    const Eigen::Vector3d world = sum[j].norm() > 1e-9 ? sum[j] : followers[j];
    const Eigen::Vector3d local = skeleton.bind[j].topLeftCorner<3, 3>().inverse() * world;
    if (local.allFinite() && local.norm() > 0.0) {
      for (Eigen::Index k = 0; k < 3; ++k)
        rig.bone_axis.data_ptr<double>()[3 * static_cast<Eigen::Index>(j) + k] = local.normalized()[k];
    }
    const double enough = kLeastSkin * static_cast<double>(rig.vertices.size(0));
    rig.is_free.data_ptr<double>()[j] = below[j] > enough ? 1.0 : 0.0;
  }
}

/// G of joint_matrices() from rotations and back, joint by joint: a tree of many small products, for which operators
/// cost more than the arithmetic.
class Kinematics : public torch::autograd::Function<Kinematics> {
 public:
  static Tensor forward(nn::AutogradContext* context, const Tensor& rotation, const Tensor& shift,
                        const std::vector<std::int64_t>& parents, const Tensor& translation, const Tensor& scale) {
    const Tensor local = rotation.contiguous(), moved = shift.contiguous();
    const std::int64_t poses = local.size(0), joints = local.size(1);
    const Tensor linear = torch::empty({poses, joints, 3, 3}, kReal), place = torch::empty({poses, joints, 3}, kReal);
    for (std::int64_t n = 0; n < poses; ++n) {
      const double* r = local.data_ptr<double>() + 9 * n * joints;
      double *l = linear.data_ptr<double>() + 9 * n * joints, *p = place.data_ptr<double>() + 3 * n * joints;
      for (std::int64_t j = 0; j < joints; ++j) {
        const Eigen::Map<const Eigen::Vector3d> t(translation.data_ptr<double>() + 3 * j),
            s(scale.data_ptr<double>() + 3 * j);
        const std::int64_t parent = parents[static_cast<std::size_t>(j)];
        const RowMatrix3 own = matrix_at(r + 9 * j) * s.asDiagonal();
        Eigen::Map<Eigen::Vector3d> to(p + 3 * j);
        if (parent < 0) {
          matrix_at(l + 9 * j) = own;
          to = t + Eigen::Map<const Eigen::Vector3d>(moved.data_ptr<double>() + 3 * n);
        } else {
          matrix_at(l + 9 * j) = matrix_at(l + 9 * parent) * own;
          to = matrix_at(l + 9 * parent) * t + Eigen::Map<Eigen::Vector3d>(p + 3 * parent);
        }
      }
    }
    context->save_for_backward({local, linear, translation, scale});
    context->saved_data["parents"] = parents;
    return torch::cat({linear, place.unsqueeze(3)}, 3);
  }

  /// With L = G's 3 × 3 part and p its place: dR_j = L_parentᵀ dL_j S_j, dL_parent += dL_j (R_j S_j)ᵀ + dp_j t_jᵀ,
  /// dp_parent += dp_j.
  static nn::variable_list backward(nn::AutogradContext* context, nn::variable_list gradients) {
    const nn::variable_list saved = nn::saved_once(*context, "forward kinematics");
    const Tensor &local = saved[0], &linear = saved[1], &translation = saved[2], &scale = saved[3];
    const std::vector<std::int64_t> parents = context->saved_data["parents"].toIntVector();
    const std::int64_t poses = local.size(0), joints = local.size(1);
    const Tensor to_linear = gradients[0].narrow(3, 0, 3).clone(at::MemoryFormat::Contiguous);
    const Tensor to_place = gradients[0].select(3, 3).clone(at::MemoryFormat::Contiguous);
    const Tensor to_local = torch::empty_like(local), to_shift = torch::empty({poses, 3}, kReal);
    for (std::int64_t n = 0; n < poses; ++n) {
      const double *r = local.data_ptr<double>() + 9 * n * joints, *l = linear.data_ptr<double>() + 9 * n * joints;
      double *dl = to_linear.data_ptr<double>() + 9 * n * joints, *dp = to_place.data_ptr<double>() + 3 * n * joints;
      double* dr = to_local.data_ptr<double>() + 9 * n * joints;
      for (std::int64_t j = joints - 1; j >= 0; --j) {
        const Eigen::Map<const Eigen::Vector3d> t(translation.data_ptr<double>() + 3 * j),
            s(scale.data_ptr<double>() + 3 * j);
        const std::int64_t parent = parents[static_cast<std::size_t>(j)];
        const RowMatrix3 own = matrix_at(r + 9 * j) * s.asDiagonal();
        const RowMatrix3 down = matrix_at(dl + 9 * j);
        const Eigen::Map<Eigen::Vector3d> place(dp + 3 * j);
        if (parent < 0) {
          matrix_at(dr + 9 * j) = down * s.asDiagonal();
          Eigen::Map<Eigen::Vector3d>(to_shift.data_ptr<double>() + 3 * n) = place;
          continue;
        }
        matrix_at(dr + 9 * j) = matrix_at(l + 9 * parent).transpose() * down * s.asDiagonal();
        matrix_at(dl + 9 * parent) += down * own.transpose() + place * t.transpose();
        Eigen::Map<Eigen::Vector3d>(dp + 3 * parent) += place;
      }
    }
    return {to_local, to_shift, Tensor(), Tensor(), Tensor()};
  }
};

}  // namespace

RigTensors rig_tensors(const Asset& asset) {
  if (asset.mesh.faces.empty()) throw InputError(asset.name, "mesh", "there is no surface to compare with a video");
  if (asset.skeleton.size() == 0 || asset.skin.rows() == 0) {
    throw InputError(asset.name, "", "has no skeleton with skin weights to pose; anigen-rig makes one");
  }
  const std::vector<std::string> wrong = validate(asset);
  if (!wrong.empty()) throw InputError(asset.name, "", wrong.front());
  RigTensors rig;
  rig.parents = asset.skeleton.parents;
  const auto joints = static_cast<std::int64_t>(asset.skeleton.size());
  rig.translation = torch::empty({joints, 3}, kReal);
  rig.scale = torch::empty({joints, 3}, kReal);
  rig.rotation = torch::empty({joints, 3, 3}, kReal);
  rig.unbind = torch::empty({joints, 4, 4}, kReal);
  const Pose bind = bind_pose(asset.skeleton);
  for (std::int64_t j = 0; j < joints; ++j) {
    const Transform& local = bind[static_cast<std::size_t>(j)];
    Eigen::Map<Eigen::Vector3d>(rig.translation.data_ptr<double>() + 3 * j) = local.translation;
    Eigen::Map<Eigen::Vector3d>(rig.scale.data_ptr<double>() + 3 * j) = local.scale;
    matrix_at(rig.rotation.data_ptr<double>() + 9 * j) = local.rotation.toRotationMatrix();
    Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(rig.unbind.data_ptr<double>() + 16 * j) =
        asset.skeleton.bind[static_cast<std::size_t>(j)].inverse();
  }
  set_surface(asset, rig);
  set_samples(rig);
  set_axes(asset.skeleton, rig);
  return rig;
}

Tensor rotations_of(const Tensor& turns) {
  // exp(ω) = 1 + a K + b K², a = sin θ / θ, b = (1 − cos θ) / θ², K the cross product with ω. θ² + 1e-12 keeps the
  // quotients finite at 0, where they differ from their limits by 1e-13.
  const Tensor square = turns.square().sum(-1, true) + 1e-12, angle = square.sqrt();
  const Tensor a = (angle.sin() / angle).unsqueeze(-1), b = (2.0 * (0.5 * angle).sin().square() / square).unsqueeze(-1);
  const Tensor x = turns.select(-1, 0), y = turns.select(-1, 1), z = turns.select(-1, 2), zero = torch::zeros_like(x);
  std::vector<std::int64_t> shape = turns.sizes().vec();
  shape.push_back(3);
  const Tensor cross = torch::stack({zero, -z, y, z, zero, -x, -y, x, zero}, -1).view(shape);
  return torch::eye(3, turns.options()) + a * cross + b * cross.matmul(cross);
}

Tensor joint_matrices(const RigTensors& rig, const Tensor& turns, const Tensor& shift) {
  const Tensor rotation = rig.rotation.matmul(rotations_of(turns));
  const std::vector<std::int64_t> parents(rig.parents.begin(), rig.parents.end());
  return Kinematics::apply(rotation, shift, parents, rig.translation, rig.scale);
}

PosedRig posed(const RigTensors& rig, const Tensor& turns, const Tensor& shift) {
  const std::int64_t poses = turns.size(0), joints = rig.joints(), count = rig.vertices.size(0);
  const Tensor skinning = joint_matrices(rig, turns, shift).matmul(rig.unbind);  // [N, J, 3, 4]
  const Tensor blended =
      rig.skin.matmul(skinning.view({poses, joints, 12})).view({poses, count, 3, 4});  // Σ_j w_vj G_j B_j⁻¹
  PosedRig result;
  // Sums of products: batched matrix products of this size cost several times as much.
  result.vertices = (blended.narrow(3, 0, 3) * rig.vertices.unsqueeze(1)).sum(3) + blended.select(3, 3);
  const torch::NoGradGuard no_grad;
  const Tensor linear = blended.detach().narrow(3, 0, 3).index_select(1, rig.color_vertex);
  const Tensor turned = (linear * rig.normals.unsqueeze(1)).sum(3);
  result.normals = turned / turned.norm(2, 2, true).clamp_min(1e-12);
  return result;
}

Tensor surface_samples(const RigTensors& rig, const Tensor& vertices) {
  const Tensor corners = rig.faces.index_select(0, rig.sample_faces);  // [P, 3]
  const Tensor places = vertices.index_select(0, corners.flatten()).view({corners.size(0), 3, 3});
  return (rig.sample_weights.unsqueeze(2) * places).sum(1);
}

}  // namespace anigen::tracking
