#include "anigen/generate/finishing.h"

#include <algorithm>
#include <system_error>
#include <utility>

#include "anigen/asset/mesh.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/geometry/correspondence.h"
#include "anigen/nn/init.h"
#include "anigen/render/picture.h"
#include "anigen/render/scene.h"
#include "anigen/render/surface_color.h"
#include "anigen/render/visibility.h"
#include "anigen/skeleton_field/skeleton_repair.h"
#include "anigen/structured_latent/decoder.h"

namespace anigen::generate {

namespace {

std::string count_of(std::size_t number, const std::string& things) { return std::to_string(number) + " " + things; }

/// The mesh alone, simplified and without what nobody sees.
Mesh finished_mesh(const Mesh& dense, const FinishingOptions& options, std::vector<std::string>& notices) {
  Mesh mesh;
  mesh.vertices = dense.vertices;
  mesh.faces = dense.faces;
  if (options.reduction > 0.0) {
    const std::size_t target = geometry::reduced_face_count(mesh.faces.size(), options.reduction);
    geometry::Simplified simplified = geometry::simplify(mesh.vertices, mesh.faces, target);
    notices.push_back("simplified from " + std::to_string(simplified.faces_before) + " to " +
                      count_of(simplified.mesh.faces.size(), "faces") +
                      (simplified.reached ? "" : ", as few as its topology allows"));
    mesh = std::move(simplified.mesh);
  }
  if (options.remove_hidden) {
    Progress progress("hidden faces", options.views, "views");
    render::HiddenFaceRemoval removal;
    removal.views.views = options.views;
    removal.views.size = options.view_size;
    removal.views.progress = [&](std::size_t) { progress.advance(); };
    render::VisibleMesh visible = render::remove_hidden_faces(mesh, removal);
    notices.push_back(count_of(visible.removed, "hidden faces removed, ") +
                      count_of(visible.filled_holes, "holes closed, ") + count_of(visible.open_holes, "left open"));
    mesh = std::move(visible.mesh);
  }
  return mesh;
}

/// Skin weights and colours at the finished mesh's vertices. Vertices that nothing replaced keep their own rows: a
/// transfer would take those of whatever lies nearest, another layer where two touch.
geometry::TransferredAttributes carried_attributes(const Asset& dense, const std::vector<Eigen::Vector3f>& vertices) {
  if (vertices == dense.mesh.vertices) return {dense.skin, dense.mesh.colors};
  return geometry::transfer_attributes(dense.mesh, dense.skin, vertices);
}

/// @return false, with a notice, for a surface in too many pieces for the texture
bool give_texture(Asset& asset, const Mesh& colored, const FinishingOptions& options, FinishedAsset& finished) {
  render::TextureOptions texture;
  texture.atlas.size = options.texture_size;
  try {
    render::TexturedAsset textured = render::textured_asset(asset, colored, texture);
    finished.notices.push_back("texture of " + std::to_string(options.texture_size) + "² texels in " +
                               count_of(textured.charts, "charts"));
    asset = std::move(textured.asset);
    return true;
  } catch (const InputError& error) {
    finished.notices.push_back(std::string("vertex colours instead of a texture: ") + error.what());
    return false;
  }
}

}  // namespace

void FinishingOptions::validate() const {
  if (!(reduction >= 0.0 && reduction < 1.0)) throw InputError("", "reduction", "must lie in [0, 1)");
  if (views < 1 || views > 100'000) throw InputError("", "views", "must lie in 1 … 100000");
  if (view_size < 16 || view_size > 8192) throw InputError("", "view size", "must lie in 16 … 8192 pixels");
  if (smoothing_iterations.value_or(0) < 0) throw InputError("", "smoothing iterations", "must not be negative");
  if (!(smoothing_alpha >= 0.0 && smoothing_alpha <= 1.0))
    throw InputError("", "smoothing alpha", "must lie in [0, 1]");
  if (!(rigid_share > 0.5 && rigid_share <= 1.0))
    throw InputError("", "rigid share", "must lie above 0.5 and not above 1");
  if (texture_size != 0 && (texture_size < 64 || texture_size > 8192))
    throw InputError("", "texture size", "must be 0 (vertex colours) or 64 … 8192");
}

FinishingOptions finishing_of_flow(FinishingOptions asked, const std::filesystem::path& flow) {
  const std::filesystem::path file = structured_latent::grouping_file(flow);
  std::error_code error;
  if (asked.smoothing_iterations || !std::filesystem::is_regular_file(file, error)) return asked;
  const Json fitted = read_json(file);
  ConfigReader reader(fitted, file.string());
  if (fitted.contains("smoothing"))
    asked.smoothing_iterations = static_cast<int>(reader.integer("smoothing", kPublishedSmoothing, 0, 1'000'000));
  return asked;
}

FinishedAsset finish_asset(const Asset& dense, const FinishingOptions& options) {
  options.validate();
  FinishedAsset finished;
  Asset& asset = finished.asset;
  asset.name = dense.name;
  asset.skeleton = dense.skeleton;
  asset.mesh = finished_mesh(dense.mesh, options, finished.notices);
  geometry::TransferredAttributes carried = carried_attributes(dense, asset.mesh.vertices);
  asset.skin = std::move(carried.skin);
  const std::size_t joints = asset.skeleton.size();
  if (options.filter_skin) {
    const int hops = published_max_hops(joints);
    asset.skin = filter_skin(asset.skin, skeleton_field::hop_distances(asset.skeleton.parents), hops);
    finished.notices.push_back("skin weights of joints more than " + count_of(hops, "hops away dropped"));
  }
  const int rounds = options.smoothing_iterations.value_or(kPublishedSmoothing);
  if (rounds > 0) {
    SkinSmoothing smoothing;
    smoothing.iterations = rounds;
    smoothing.alpha = options.smoothing_alpha;
    asset.skin = smooth_skin(asset.skin, MeshEdges(asset.mesh.faces, asset.mesh.vertices.size()), joints, smoothing);
    finished.notices.push_back("skin weights smoothed " + count_of(smoothing.iterations, "times"));
  }
  if (options.rigid_parts) {
    RigidSkin rigid = rigid_parts(asset.mesh, asset.skin, options.rigid_share);
    finished.notices.push_back(rigid.note());
    finished.rigid_parts = rigid.to_json(asset.skeleton);
    asset.skin = std::move(rigid.skin);
  }
  asset.mesh.normals = angle_weighted_normals(asset.mesh.vertices, asset.mesh.faces);
  if (options.texture_size > 0 && !dense.mesh.colors.empty() && give_texture(asset, dense.mesh, options, finished))
    return finished;
  asset.mesh.colors = std::move(carried.colors);
  asset.materials = dense.materials;
  asset.mesh.face_materials.assign(dense.materials.empty() ? 0 : asset.mesh.faces.size(), 0);
  return finished;
}

}  // namespace anigen::generate
