#pragma once
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>

#include "anigen/core/random.h"
#include "anigen/io/image.h"
#include "anigen/render/cameras_json.h"

namespace anigen::test {

/// A disc of one colour on transparent ground that has the same colour, with a rim of one half-transparent pixel.
inline io::Image disc_cutout(int side, std::uint32_t rgb) {
  io::Image image(side, side, rgb << 8);
  const double middle = 0.5 * (side - 1), radius = 0.3 * side;
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      const double inside = radius - std::hypot(x - middle, y - middle);
      image.pixel(x, y)[3] = inside > 0.5 ? 255 : inside > -0.5 ? 128 : 0;
    }
  }
  return image;
}

/// A dataset of which only condition views are there: disc0, disc1, … of different colours, two views each. The last
/// one is in splits/test.txt. @param identifier column file_identifier of the first one
inline void write_disc_dataset(const std::filesystem::path& root, int count, const std::string& identifier = "") {
  constexpr std::uint32_t kColors[] = {0xC83232, 0x32C850, 0x3C5AD2, 0xDCC832};
  std::filesystem::create_directories(root / "splits");
  std::ofstream csv(root / "metadata.csv"), split(root / "splits/test.txt");
  csv << "sha256,aesthetic_score,cond_rendered,file_identifier\n";
  for (int i = 0; i < count; ++i) {
    const std::string id = "disc" + std::to_string(i);
    csv << id << ",6.5,True," << (i == 0 ? identifier : "") << "\n";
    Rng rng(5, "views", static_cast<std::uint64_t>(i));
    const render::Transforms views = render::make_transforms(render::front_views(2, rng), {});
    const std::filesystem::path folder = root / "renders_cond" / id;
    std::filesystem::create_directories(folder);
    for (const render::Frame& frame : views.frames)
      io::write_png(folder / frame.file_path, disc_cutout(96, kColors[i % 4]));
    render::write_transforms(folder / "transforms.json", views);
  }
  split << "disc" << count - 1 << "\n";
}

}  // namespace anigen::test
