// The rasteriser and the mesh renderer. The fixture was made with exact coverage, so everything is compared at the
// finest grid there is, and then, but for the gradients, at the published 1/16 pixel, where a pixel counts only at that
// distance from every edge. Pixels too close to call take the expected value.
#include <algorithm>
#include <string>

#include "anigen/raster/antialias.h"
#include "anigen/raster/interpolate.h"
#include "anigen/raster/mesh_renderer.h"
#include "anigen/raster/rasterize.h"
#include "tests/parity/raster_visibility.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using torch::Tensor;

// A grid, how far from an edge its coverage is sure (as the fixture's tolerance note says for exact coverage and for
// nvdiffrast), and how many pixels that must leave.
struct CoverageGrid {
  std::int64_t subpixel_bits;
  double edge_distance, least_share;
};
constexpr CoverageGrid kFinest{raster::kMostSubpixelBits, 1e-3, 0.95}, kPublished{4, 0.1, 0.25};
constexpr double kSureDepthGap = 1e-5;

struct RasterCase {
  RasterCase(const Fixture& fixture, const std::string& mesh_name, std::int64_t subpixel_bits)
      : mesh(mesh_name),
        vertices(fixture.input(mesh + ".vertices").requires_grad_()),
        faces(fixture.input(mesh + ".faces").to(torch::kInt64)),
        attributes(fixture.input(mesh + ".vertex_attrs").requires_grad_()),
        specified(fixture.input(mesh + ".specified")),
        extrinsics(fixture.input(mesh + ".extrinsics")),
        intrinsics(fixture.input(mesh + ".intrinsics")) {
    options.resolution = fixture.config().at("resolution");
    options.near = fixture.config().at("near");
    options.far = fixture.config().at("far");
    options.ssaa = fixture.config().at("ssaa");
    options.subpixel_bits = subpixel_bits;
  }

  Tensor clip() const {
    return raster::to_clip(vertices, extrinsics, raster::projection_matrix(intrinsics, options.near, options.far));
  }
  raster::Rendering render(std::int64_t ssaa) const {
    raster::RenderOptions chosen = options;
    chosen.ssaa = ssaa;
    return raster::render_mesh(vertices, faces, torch::cat({attributes, specified}, 1), extrinsics, intrinsics, chosen);
  }

  std::string mesh;
  Tensor vertices, faces, attributes, specified, extrinsics, intrinsics;
  raster::RenderOptions options;
};

// Compares pixels that are sure, whatever axes an image has before or after its two.
class SurePixels {
 public:
  SurePixels(Fixture& fixture, const std::string& mesh, const CoverageGrid& grid) : fixture_(fixture), mesh_(mesh) {
    const Tensor edge = fixture.expected(mesh + ".edge_distance"), gap = fixture.expected(mesh + ".z_gap");
    sure_ = (edge > grid.edge_distance).logical_and(gap > kSureDepthGap);
    // And all four neighbours: what lies outside the picture is sure.
    const std::int64_t rows = sure_.size(0), columns = sure_.size(1);
    sure_around_ = sure_.clone();
    for (const std::int64_t axis : {0, 1}) {
      const std::int64_t length = axis == 0 ? rows : columns;
      sure_around_.narrow(axis, 1, length - 1).logical_and_(sure_.narrow(axis, 0, length - 1));
      sure_around_.narrow(axis, 0, length - 1).logical_and_(sure_.narrow(axis, 1, length - 1));
    }
    const auto count = sure_.sum().item<std::int64_t>();
    fixture.check_true(mesh + ": " + std::to_string(count) + " of " + std::to_string(sure_.numel()) +
                           " pixels are farther than " + std::to_string(grid.edge_distance) + " from every edge",
                       static_cast<double>(count) >= grid.least_share * static_cast<double>(sure_.numel()));
  }

  /// @param image [H, W] or [H, W, C] before antialiasing
  void check(const std::string& name, const Tensor& image) {
    compare(name, image, image.dim() == 3 ? sure_.unsqueeze(2) : sure_);
  }
  /// @param image [H, W] or [H, W, 3]; the fixture has channels first
  void check_antialiased(const std::string& name, const Tensor& image) {
    compare(name, image.dim() == 3 ? image.permute({2, 0, 1}) : image, sure_around_);
  }

 private:
  void compare(const std::string& name, const Tensor& image, const Tensor& sure) {
    const Tensor wanted = fixture_.expected(mesh_ + "." + name);
    const Tensor found = image.detach().to(wanted.scalar_type());
    fixture_.check(mesh_ + "." + name, found.sizes() == wanted.sizes() ? torch::where(sure, found, wanted) : found);
  }

  Fixture& fixture_;
  std::string mesh_;
  Tensor sure_, sure_around_;
};

void check_images(Fixture& fixture, const RasterCase& c, const CoverageGrid& grid) {
  SurePixels sure(fixture, c.mesh, grid);
  const Tensor clip = c.clip();
  fixture.check(c.mesh + ".clip", clip);
  const raster::Fragments fragments =
      raster::rasterize(clip, c.faces, c.options.resolution, c.options.resolution, c.options.subpixel_bits);
  sure.check("triangle", fragments.triangle - 1);
  sure.check("bary", fragments.barycentric);
  sure.check("zw", fragments.depth);
  sure.check("depth_raw", raster::interpolate(clip.narrow(1, 3, 1), fragments, c.faces).squeeze(2));
  const Tensor normals = raster::face_normals(c.vertices, c.faces);
  fixture.check(c.mesh + ".face_normal", normals);
  const Tensor same = torch::arange(c.faces.size(0), torch::kInt64).unsqueeze(1).expand({c.faces.size(0), 3});
  sure.check("normal_raw", raster::interpolate(normals, fragments, same));

  const raster::Rendering rendering = c.render(c.options.ssaa);
  sure.check_antialiased("mask", rendering.mask);
  sure.check_antialiased("depth", rendering.depth);
  sure.check_antialiased("normal", rendering.normal);
  sure.check_antialiased("color", rendering.attributes.narrow(2, 0, 3));
  sure.check_antialiased("normal_map", rendering.attributes.narrow(2, 3, 3));
  sure.check_antialiased("specified", rendering.attributes.narrow(2, 6, 3));
  if (grid.subpixel_bits != kFinest.subpixel_bits) return;

  // The fixture does not mark the sure pixels of the larger image; with this grid all of them should be.
  const raster::Rendering larger = c.render(2);
  fixture.check(c.mesh + ".mask_ssaa2", larger.mask);
  fixture.check(c.mesh + ".normal_ssaa2", larger.normal.permute({2, 0, 1}));
  const raster::SilhouettePairs pairs = raster::find_silhouette_pairs(fragments, clip, c.faces);
  fixture.check(c.mesh + ".aa_pairs", torch::full({}, pairs.index.size(0), torch::kInt64));
}

// Within a share of the largest entry, as the fixture's tolerance says: "1e-3 of the largest absolute entry …".
void check_gradient(Fixture& fixture, const std::string& name, const Tensor& found) {
  const double share = std::stod(fixture.json().at("tolerance").at("gradients").get<std::string>());
  const Tensor wanted = fixture.expected(name);
  if (found.sizes() != wanted.sizes()) {
    fixture.check(name, found);
    return;
  }
  const double largest = wanted.abs().max().item<double>(), error = (found - wanted).abs().max().item<double>();
  fixture.check_true(
      name + ": within " + std::to_string(error / largest) + " of the largest entry, limit " + std::to_string(share),
      error <= share * largest);
  fixture.check(name, error <= share * largest ? wanted : found);
}

void check_gradients(Fixture& fixture, const RasterCase& c) {
  const raster::Rendering rendering = c.render(c.options.ssaa);
  const auto gradients = [&](const Tensor& image, const std::string& direction) {
    return torch::autograd::grad({image}, {c.vertices, c.attributes}, {fixture.input(c.mesh + "." + direction)},
                                 /*retain_graph=*/true, /*create_graph=*/false, /*allow_unused=*/true);
  };
  check_gradient(fixture, c.mesh + ".grad_mask_vertices", gradients(rendering.mask, "g_mask")[0]);
  check_gradient(fixture, c.mesh + ".grad_depth_vertices", gradients(rendering.depth, "g_depth")[0]);
  const auto color = gradients(rendering.attributes.narrow(2, 0, 3).permute({2, 0, 1}), "g_color");
  check_gradient(fixture, c.mesh + ".grad_color_vertices", color[0]);
  check_gradient(fixture, c.mesh + ".grad_color_attrs", color[1]);
}

void run_raster_mesh(Fixture& fixture) {
  const std::size_t meshes = fixture.config().at("meshes").size();
  for (std::size_t m = 0; m < meshes; ++m) {
    const std::string mesh = "m" + std::to_string(m);
    const RasterCase exact(fixture, mesh, kFinest.subpixel_bits);
    check_images(fixture, exact, kFinest);
    check_gradients(fixture, exact);
    check_images(fixture, RasterCase(fixture, mesh, kPublished.subpixel_bits), kPublished);
    check_ray_traced_visibility(fixture, mesh);
    fixture.defer(mesh + ".edge_distance", "says where to compare");
    fixture.defer(mesh + ".z_gap", "says where to compare");
  }
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_raster_mesh, anigen::test::run_raster_mesh)
