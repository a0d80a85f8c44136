#include "anigen/train/pictures.h"

#include <vector>

#include "anigen/nn/init.h"
#include "anigen/render/picture.h"
#include "anigen/render/scene.h"

namespace anigen::train {

using torch::Tensor;

Mesh mesh_of(const Tensor& vertices, const Tensor& faces) {
  Mesh mesh;
  mesh.vertices = nn::points_of<float>(vertices, "vertices");
  const Tensor corners = faces.to(torch::kCPU, torch::kInt64).contiguous();
  const std::int64_t* corner = corners.data_ptr<std::int64_t>();
  mesh.faces.resize(static_cast<std::size_t>(corners.size(0)));
  for (Triangle& face : mesh.faces) {
    for (std::int32_t& index : face) index = static_cast<std::int32_t>(*corner++);
  }
  return mesh;
}

namespace {

render::PictureOptions rig_picture() {
  render::PictureOptions options;
  options.width = options.height = kRigPictureSize;
  Box box;
  box.extend(Eigen::Vector3d::Constant(-0.5));
  box.extend(Eigen::Vector3d::Constant(0.5));
  options.view.fit = box;
  return options;
}

}  // namespace

void set_vertex_colors(Mesh& mesh, const Tensor& attributes) {
  if (!attributes.defined() || attributes.size(1) < 3) return;
  const Tensor colors = attributes.slice(1, 0, 3).to(torch::kCPU, torch::kFloat32).clamp(0.0, 1.0).contiguous();
  const float* value = colors.data_ptr<float>();
  mesh.colors.resize(mesh.vertices.size());
  for (Eigen::Vector4f& color : mesh.colors) {
    for (int c = 0; c < 3; ++c) color[c] = render::srgb_to_linear(*value++);
    color[3] = 1.0F;
  }
}

io::Image picture_with_skeleton(const Asset& asset, const skeleton_field::SkeletonTensors& skeleton) {
  render::PictureOptions options = rig_picture();
  options.skeleton = true;
  options.joints = nn::points_of<double>(skeleton.joints, "joints");
  const Tensor parents = skeleton.parents.to(torch::kCPU, torch::kInt32).contiguous();
  options.parents.emplace(parents.data_ptr<int>(), parents.data_ptr<int>() + parents.size(0));
  return render::render(asset, options);
}

io::Image picture_with_weights(const Asset& asset, const Tensor& weights) {
  render::PictureOptions options = rig_picture();
  options.mode = render::PictureMode::kWeights;
  const Tensor rows = weights.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  const float* first = rows.data_ptr<float>();
  options.weights = from_dense(std::vector<float>(first, first + rows.numel()), static_cast<std::size_t>(rows.size(0)),
                               static_cast<std::size_t>(rows.size(1)));
  return render::render(asset, options);
}

io::Image empty_rig_picture() { return io::Image(kRigPictureSize, kRigPictureSize); }

}  // namespace anigen::train
