// Pictures of what the structured latents give back.
#include <algorithm>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/short_id.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/raytrace/picture.h"
#include "anigen/raytrace/srgb.h"
#include "anigen/train/structured_latent_autoencoder_stage.h"
#include "anigen/train/tensor_mesh.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr int kPictureSize = 256;
constexpr int kSheetColumns = 4;

raytrace::PictureOptions sheet_picture() {
  raytrace::PictureOptions options;
  options.width = options.height = kPictureSize;
  Box box;  // the same for all, so that sizes can be compared
  box.extend(Eigen::Vector3d::Constant(-0.5));
  box.extend(Eigen::Vector3d::Constant(0.5));
  options.view.fit = box;
  return options;
}

// The first three attributes of the vertices, sRGB in [0, 1], as the mesh's colours.
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

io::Image with_skeleton(const Asset& asset, const fields::SkeletonTensors& skeleton) {
  raytrace::PictureOptions options = sheet_picture();
  options.skeleton = true;
  options.joints = joint_positions(skeleton.joints);
  options.parents = joint_parents(skeleton.parents);
  return raytrace::render(asset, options);
}

io::Image with_weights(const Asset& asset, const Tensor& weights) {
  raytrace::PictureOptions options = sheet_picture();
  options.mode = raytrace::PictureMode::kWeights;
  options.weights = skin_of(weights);
  return raytrace::render(asset, options);
}

}  // namespace

void StructuredLatentAutoEncoderStage::sample(const std::filesystem::path& folder) {
  if (!held_out_ || held_out_->size() == 0 || options_.sample_assets == 0) return;
  const torch::NoGradGuard no_grad;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error(folder.string() + ": cannot create folder: " + error.message());

  std::vector<raytrace::Tile> tiles;
  for (std::size_t i = 0; i < std::min(static_cast<std::size_t>(options_.sample_assets), held_out_->size()); ++i) {
    const Reconstruction made = reconstruct(i);
    const fields::ExtractedMesh& mesh = made.meshes.front();
    const fields::SkeletonTensors& truth = made.inputs.skeletons.front();
    Asset given, decoded;
    given.mesh = mesh_of(made.inputs.rigs.vertices.front(), made.inputs.rigs.faces.front());
    tiles.push_back({with_skeleton(given, truth), short_id(made.id) + ": truth"});
    const io::Image nothing(kPictureSize, kPictureSize);
    if (!mesh.success) {
      tiles.push_back({nothing, "no surface"});
      tiles.push_back({with_weights(given, made.inputs.rigs.skin.front()), "true weights"});
      tiles.push_back({nothing, ""});
      continue;
    }
    decoded.mesh = mesh_of(mesh.vertices, mesh.faces);
    set_vertex_colors(decoded.mesh, mesh.attributes);
    tiles.push_back({with_skeleton(decoded, made.grouped), "reconstruction"});
    tiles.push_back({with_weights(given, made.inputs.rigs.skin.front()), "true weights"});
    if (options_.variant.geometry_only) {
      tiles.push_back({nothing, ""});
      continue;
    }
    const Tensor weights =
        decoder_->skin_weights(mesh.skin_features, truth, made.decoded.joint_features.front().features);
    tiles.push_back({with_weights(decoded, weights), "decoded weights"});
  }
  raytrace::SheetOptions sheet;
  sheet.columns = kSheetColumns;
  sheet.text_height = 11;
  io::write_png(folder / "reconstructions.png", raytrace::contact_sheet(tiles, sheet));
}

}  // namespace anigen::train
