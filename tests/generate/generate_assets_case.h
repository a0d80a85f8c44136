#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>

#include "anigen/core/error.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/io/image.h"
#include "tests/generate/small_runs.h"
#include "tests/support/paths.h"

namespace anigen::generate {

/// A blue disc on transparent ground.
inline io::Image blue_disc(int side) {
  io::Image image(side, side, 0);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      if (std::hypot(x - side / 2, y - side / 2) > side / 3.0) continue;
      const std::uint8_t color[] = {40, static_cast<std::uint8_t>(2 * x), 200, 255};
      std::copy(color, color + 4, image.pixel(x, y));
    }
  }
  return image;
}

/// Small models of the parity fixtures and a picture.
class GenerateAssets : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::filesystem::path tree = test::parity_file("ckpt_tree");
    if (!std::filesystem::is_directory(tree)) {
      GTEST_SKIP() << tree << " is not there";
    }
    std::filesystem::copy(tree, folder_.path(), std::filesystem::copy_options::recursive);
    const std::filesystem::path runs = folder_ / "ckpts" / "anigen";
    request_.models.structure_flow = runs / "ss_flow_solo";
    request_.models.latent_flow = runs / "slat_flow_control";
    test::give_image_encoder(request_.models.structure_flow);
    test::give_image_encoder(request_.models.latent_flow);
    request_.output = folder_ / "out";
    request_.finishing.reduction = 0.8;
    request_.finishing.views = 12;
    request_.finishing.view_size = 64;
    request_.finishing.texture_size = 256;
    picture_ = folder_ / "disc.png";
    io::write_png(picture_, blue_disc(96));
  }

  std::filesystem::path made(const std::string& name, const std::string& file) const {
    return request_.output / name / file;
  }
  GenerationReport one(const std::string& name) {
    GenerateRequest request = request_;
    request.name = name;
    return generate_assets(request, {picture_}).front();
  }

  std::string one_failure(const std::string& name) {
    try {
      return one(name).failure;
    } catch (const InputError& error) {
      return error.what();
    }
  }

  test::TemporaryFolder folder_;
  GenerateRequest request_;
  std::filesystem::path picture_;
};

}  // namespace anigen::generate
