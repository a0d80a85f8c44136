// Makes one creature of every family and draws it twice: in colour, and with its skeleton over its skin weights.
//   example_creature_sheet OUT.png [seed]
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <vector>

#include "anigen/core/parallel.h"
#include "anigen/creatures/body.h"
#include "anigen/io/image.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fprintf(stderr, "usage: example_creature_sheet OUT.png [seed]\n");
    return 2;
  }
  try {
    const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 0;
    const std::vector<std::string>& families = anigen::creatures::creature_families();
    std::vector<anigen::render::Tile> tiles(2 * families.size());
    anigen::parallel_for(families.size(), [&](std::size_t i) {
      const anigen::Asset asset = anigen::creatures::make_creature(families[i], seed, 6);
      anigen::render::PictureOptions options;
      options.width = options.height = 200;
      options.samples_per_axis = 4;
      options.ground_shadow = true;
      tiles[2 * i] = {anigen::render::render(asset, options), families[i]};
      options.mode = anigen::render::PictureMode::kWeights;
      options.skeleton = true;
      options.ground_shadow = false;
      tiles[2 * i + 1] = {anigen::render::render(asset, options), std::to_string(asset.skeleton.size()) + " joints"};
    });
    anigen::render::SheetOptions sheet;
    sheet.columns = 6;
    sheet.gap = 6;
    sheet.text_height = 10;
    anigen::io::write_png(argv[1], anigen::render::contact_sheet(tiles, sheet));
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
