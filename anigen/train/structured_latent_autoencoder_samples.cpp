// Pictures of what the structured latents give back.
#include <algorithm>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/short_id.h"
#include "anigen/raytrace/contact_sheet.h"
#include "anigen/train/rig_pictures.h"
#include "anigen/train/structured_latent_autoencoder_stage.h"
#include "anigen/train/tensor_mesh.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr int kSheetColumns = 4;

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
    tiles.push_back({picture_with_skeleton(given, truth), short_id(made.id) + ": truth"});
    const io::Image nothing = empty_rig_picture();
    if (!mesh.success) {
      tiles.push_back({nothing, "no surface"});
      tiles.push_back({picture_with_weights(given, made.inputs.rigs.skin.front()), "true weights"});
      tiles.push_back({nothing, ""});
      continue;
    }
    decoded.mesh = mesh_of(mesh.vertices, mesh.faces);
    set_vertex_colors(decoded.mesh, mesh.attributes);
    tiles.push_back({picture_with_skeleton(decoded, made.grouped), "reconstruction"});
    tiles.push_back({picture_with_weights(given, made.inputs.rigs.skin.front()), "true weights"});
    if (options_.variant.geometry_only) {
      tiles.push_back({nothing, ""});
      continue;
    }
    const Tensor weights =
        decoder_->skin_weights(mesh.skin_features, truth, made.decoded.joint_features.front().features);
    tiles.push_back({picture_with_weights(decoded, weights), "decoded weights"});
  }
  raytrace::SheetOptions sheet;
  sheet.columns = kSheetColumns;
  sheet.text_height = 11;
  io::write_png(folder / "reconstructions.png", raytrace::contact_sheet(tiles, sheet));
}

}  // namespace anigen::train
