// Draws posed variants of assets: a row per asset, first the asset itself, then poses of it.
//   example_augmentation_sheet OUT.png ASSET... [--variants N] [--seed S] [--all] [--size PIXELS]
// ASSET is a .glb or .gltf file, or creature:FAMILY; with random: before it, its own animations are left alone. The
// provenance of every variant goes to the screen as JSON, a line each.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/image.h"
#include "anigen/prepare/pose_augmentation.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace {

using namespace anigen;

Asset read(const std::string& name) {
  const std::string prefix = "creature:";
  Asset asset = name.rfind(prefix, 0) == 0 ? creatures::make_creature(name.substr(prefix.size()), 0, 6)
                                           : io::read_gltf(name).asset;
  if (asset.name.empty() || name.rfind(prefix, 0) != 0) asset.name = std::filesystem::path(name).stem().string();
  normalize(asset);
  return asset;
}

render::Tile tile(const Asset& asset, const std::string& caption, int size) {
  render::PictureOptions options;
  options.width = options.height = size;
  options.samples_per_axis = 3;
  return {render::render(asset, options), caption};
}

std::string caption(const prepare::Provenance& provenance) {
  char text[80];
  if (provenance.kind == prepare::PoseKind::kRandom) {
    std::snprintf(text, sizeof text, "%zu joints, to %.0f deg", provenance.turned, provenance.largest_angle);
  } else if (provenance.blend > 0.0) {
    std::snprintf(text, sizeof text, "own motion, %.2f to %.2f s", provenance.time, provenance.second_time);
  } else {
    std::snprintf(text, sizeof text, "own motion, %.2f s", provenance.time);
  }
  return text;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"Draws posed variants of assets"};
  std::string out;
  std::vector<std::string> names;
  std::size_t variants = 5;
  std::uint64_t seed = 0;
  int size = 150;
  bool all = false;
  app.add_option("out", out, "PNG to write")->required();
  app.add_option("assets", names, "files, or creature:FAMILY; random: before either")->required();
  app.add_option("--variants", variants)->capture_default_str();
  app.add_option("--seed", seed)->capture_default_str();
  app.add_option("--size", size, "of a picture, pixels")->capture_default_str();
  app.add_flag("--all", all, "take every pose, however collapsed");
  CLI11_PARSE(app, argc, argv);
  try {
    prepare::PoseAugmentation options;
    if (all) options.limits = {1e-6, 0, 1e-3, 1e3, 0, 0, 1e3, 0, 1e3, 1, 1, 1};
    std::vector<render::Tile> tiles(names.size() * (variants + 1));
    std::vector<std::string> lines(tiles.size());
    parallel_for(names.size(), [&](std::size_t row) {
      const std::size_t first = row * (variants + 1);
      const std::string random = "random:";
      prepare::PoseAugmentation own = options;
      own.own_motion = names[row].rfind(random, 0) != 0;
      const Asset asset = read(own.own_motion ? names[row] : names[row].substr(random.size()));
      tiles[first] = tile(asset, asset.name, size);
      const prepare::PoseAugmenter augmenter(asset, asset.name, seed, own);
      for (std::size_t k = 0; k < variants; ++k) {
        prepare::Provenance provenance;
        const std::optional<Asset> posed = augmenter.variant(k, provenance);
        tiles[first + 1 + k] =
            posed ? tile(*posed, caption(provenance), size) : render::Tile{io::Image(size, size), "rejected"};
        lines[first + 1 + k] = to_json(provenance).dump();
      }
    });
    for (const std::string& line : lines) {
      if (!line.empty()) std::printf("%s\n", line.c_str());
    }
    render::SheetOptions sheet;
    sheet.columns = static_cast<int>(variants + 1);
    sheet.gap = 6;
    sheet.text_height = 9;
    io::write_png(out, render::contact_sheet(tiles, sheet));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
