// Shows what a dataset's views look like: for every asset a colour view, its world normals, its depth, the normals in
// the camera's frame that condition the first stage, and a condition view, from the published cameras.
//   example_view_sheet OUT.png ASSET.glb...
#include <algorithm>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/random.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/render/cameras_json.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/dataset_views.h"

namespace {

using namespace anigen::render;

constexpr int kSize = 192, kSamples = 4;

/// Grey from near (light) to far (dark) within the object.
anigen::io::Image depth_picture(const ViewImages& view) {
  float nearest = 1e30f, farthest = 0.0f;
  for (const float depth : view.depth) {
    if (depth <= 0.0f) continue;
    nearest = std::min(nearest, depth);
    farthest = std::max(farthest, depth);
  }
  anigen::io::Image image(view.size, view.size, 0);
  for (std::size_t i = 0; i < view.depth.size(); ++i) {
    if (view.depth[i] <= 0.0f) continue;
    const float share = (farthest - view.depth[i]) / std::max(1e-6f, farthest - nearest);
    for (std::size_t c = 0; c < 3; ++c) image.rgba[4 * i + c] = static_cast<std::uint8_t>(40.0f + 200.0f * share);
    image.rgba[4 * i + 3] = 255;
  }
  return image;
}

void add_asset(std::vector<Tile>& tiles, const std::string& path) {
  anigen::Asset asset = anigen::io::read_gltf(path).asset;
  anigen::normalize(asset);
  const Scene scene(asset);
  const ViewRenderer renderer(scene);
  anigen::Rng rng(0, "views");
  // From the front, which glTF has at −Y, a little to the side and from above.
  ViewCamera front;
  front.yaw = -1.1;
  front.pitch = 0.3;
  front.radius = kFeatureRadius;
  front.fov = kFeatureFov;
  const Frame frame = make_frame(front, "000.png"), condition = make_frame(condition_views(24, rng)[17], "017.png");
  ViewOptions options;
  options.size = kSize;
  options.samples_per_axis = kSamples;
  options.geometry = options.mean_normal = true;
  const ViewImages view = renderer.render(frame, options);
  tiles.push_back({view.color, asset.name});
  tiles.push_back({encode_world_normals(view), "world normals"});
  tiles.push_back({depth_picture(view), "depth"});
  tiles.push_back({encode_condition_normals(view, frame), "camera normals"});
  tiles.push_back({renderer.render(condition, options).color, "condition view"});
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) {
    std::fprintf(stderr, "usage: example_view_sheet OUT.png ASSET.glb...\n");
    return 2;
  }
  try {
    std::vector<Tile> tiles;
    for (int i = 2; i < argc; ++i) add_asset(tiles, argv[i]);
    SheetOptions sheet;
    sheet.columns = tiles.size() > 20 ? 10 : 5;
    sheet.gap = 6;
    sheet.text_height = 10;
    anigen::io::write_png(argv[1], contact_sheet(tiles, sheet));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
