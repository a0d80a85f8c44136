#include "anigen/train/rig_pictures.h"

#include "anigen/raytrace/picture.h"
#include "anigen/raytrace/srgb.h"
#include "anigen/train/tensor_mesh.h"

namespace anigen::train {
namespace {

raytrace::PictureOptions rig_picture() {
  raytrace::PictureOptions options;
  options.width = options.height = kRigPictureSize;
  Box box;
  box.extend(Eigen::Vector3d::Constant(-0.5));
  box.extend(Eigen::Vector3d::Constant(0.5));
  options.view.fit = box;
  return options;
}

}  // namespace

using torch::Tensor;

void set_vertex_colors(Mesh& mesh, const Tensor& attributes) {
  if (!attributes.defined() || attributes.size(1) < 3) return;
  const Tensor colors = attributes.slice(1, 0, 3).to(torch::kCPU, torch::kFloat32).clamp(0.0, 1.0).contiguous();
  const float* value = colors.data_ptr<float>();
  mesh.colors.resize(mesh.vertices.size());
  for (Eigen::Vector4f& color : mesh.colors) {
    for (int c = 0; c < 3; ++c) color[c] = raytrace::srgb_to_linear(*value++);
    color[3] = 1.0F;
  }
}

io::Image picture_with_skeleton(const Asset& asset, const fields::SkeletonTensors& skeleton) {
  raytrace::PictureOptions options = rig_picture();
  options.skeleton = true;
  options.joints = joint_positions(skeleton.joints);
  options.parents = joint_parents(skeleton.parents);
  return raytrace::render(asset, options);
}

io::Image picture_with_weights(const Asset& asset, const Tensor& weights) {
  raytrace::PictureOptions options = rig_picture();
  options.mode = raytrace::PictureMode::kWeights;
  options.weights = skin_of(weights);
  return raytrace::render(asset, options);
}

io::Image empty_rig_picture() { return io::Image(kRigPictureSize, kRigPictureSize); }

}  // namespace anigen::train
