#include "anigen/vision/picture_estimator.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/table.h"
#include "anigen/data/picture_dataset.h"
#include "anigen/geometry/primitives.h"
#include "anigen/io/image.h"
#include "anigen/render/dataset_views.h"
#include "anigen/train/stages/stages.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/patch_encoder.h"
#include "tests/train/stages/run_folder.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr int kViews = 4, kRendered = 192, kAssets = 3;

Eigen::Vector3d middle_of(int asset) { return {0.08 * asset, -0.05, 0.1 * asset - 0.1}; }
double radius_of(int asset) { return 0.2 + 0.04 * asset; }

// Balls off the origin, seen from the front, as anigen-prepare --cond-views --view-geometry writes them.
class Balls : public ::testing::Test {
 protected:
  Balls() {
    std::filesystem::create_directories(folder_ / "data/splits");
    std::ofstream csv(folder_ / "data/metadata.csv"), split(folder_ / "data/splits/test.txt");
    csv << "sha256,aesthetic_score,is_bad_skin,is_bad_skeleton,cond_rendered,source\n";
    for (int i = 0; i < kAssets; ++i) {
      csv << "ball" << i << ",6.5,False,False,True,procedural:ball" << i % 2 << "\n";
      render(i);
    }
    split << "ball" << kAssets - 1 << "\n";
    write_file_atomically(folder_ / "config.json", R"({
      "models": {"estimator": {"name": "PictureEstimator", "args": {
        "image_size": 32, "width": 64, "num_blocks": 1, "num_heads": 2, "families": 2}}},
      "dataset": {"name": "AniGenPictures", "args": {"image_size": 32, "eval_split": "splits/test.txt",
        "families": ["procedural:ball0", "procedural:ball1"]}},
      "trainer": {"name": "AniGenPictureEstimatorTrainer", "args": {
        "max_steps": 60, "batch_size": 4, "seed": 3, "ema_rate": [0.9], "fp16_mode": "none",
        "optimizer": {"name": "AdamW", "args": {"lr": 0.003}},
        "i_log": 20, "i_print": 0, "i_save": 30, "i_eval": 60, "i_sample": 0}}})");
  }

  void render(int asset) const {
    Asset ball;
    ball.mesh = geometry::icosphere(4, radius_of(asset));
    for (Eigen::Vector3f& vertex : ball.mesh.vertices) vertex += middle_of(asset).cast<float>();
    const float blue = 0.4F * static_cast<float>(asset);
    ball.mesh.colors.assign(ball.mesh.vertices.size(), Eigen::Vector4f(0.9F - blue, 0.3F, 0.1F + blue, 1.0F));
    const render::Scene scene(ball);
    const render::ViewRenderer renderer(scene);
    Rng rng(7, "views", static_cast<std::uint64_t>(asset));
    render::Transforms views = render::make_transforms(render::front_views(kViews, rng), {});
    render::ViewOptions options;
    options.size = kRendered;
    options.mean_normal = options.geometry = true;
    const std::filesystem::path folder = this->views(asset);
    std::filesystem::create_directories(folder);
    for (render::Frame& frame : views.frames) {
      const render::ViewImages images = renderer.render(frame, options);
      const std::string stem = std::filesystem::path(frame.file_path).stem().string();
      io::write_png(folder / frame.file_path, images.color);
      io::write_png(folder / (stem + "_normal.png"), render::encode_condition_normals(images, frame));
      const std::vector<std::uint8_t> depth = render::encode_depth_png(images);
      write_file_atomically(folder / (stem + "_depth.png"),
                            {reinterpret_cast<const char*>(depth.data()), depth.size()});
    }
    render::write_transforms(folder / "transforms.json", views);
  }

  std::filesystem::path views(int asset) const {
    return folder_ / "data/renders_cond" / ("ball" + std::to_string(asset));
  }

  test::TemporaryFolder folder_;
};

Tensor row_of(const render::PartCamera& c) {
  return torch::tensor({std::sin(c.yaw), std::cos(c.yaw), c.pitch, std::log(c.scale), c.shift_x, c.shift_y, c.nearness},
                       torch::kFloat32)
      .unsqueeze(0);
}

TEST_F(Balls, TheTruthLiesOnTheBallWhereTheCameraSeesIt) {
  constexpr int kSize = 64, kHalf = kSize / 2;
  for (int asset = 0; asset < kAssets; ++asset) {
    for (std::uint64_t draw = 0; draw < 4; ++draw) {
      Rng rng(11, "draw", draw);
      const data::PictureTruth truth = data::read_picture_truth(views(asset), kSize, rng);
      const Tensor places = torch::tensor(truth.coordinates).view({3, kHalf * kHalf}).t().contiguous();
      const Tensor seen = vision::seen_from(row_of(truth.camera), places)[0];
      const Eigen::Vector3d back(std::cos(truth.camera.yaw) * std::cos(truth.camera.pitch),
                                 std::sin(truth.camera.yaw) * std::cos(truth.camera.pitch),
                                 std::sin(truth.camera.pitch));
      int known = 0;
      for (int i = 0; i < kHalf * kHalf; ++i) {
        if (truth.mask[static_cast<std::size_t>(i)] == 0.0F) continue;
        ++known;
        const Eigen::Vector3d place(places[i][0].item<double>(), places[i][1].item<double>(),
                                    places[i][2].item<double>());
        // The mesh is a ball to 0.2 % of its radius, a depth is stored in steps of 0.0002.
        EXPECT_NEAR((place - middle_of(asset)).norm(), radius_of(asset), 2e-3);
        // Truth is that of the nearest pixel of the picture, at most half of one away.
        const double step = 0.75 / kHalf;
        EXPECT_NEAR(seen[i][0].item<double>(), (i % kHalf + 0.5) / kHalf, step);
        EXPECT_NEAR(seen[i][1].item<double>(), (i / kHalf + 0.5) / kHalf, step);
        EXPECT_NEAR(seen[i][2].item<double>(), place.dot(back), 1e-5);
        // A ball's normal points away from its middle; bytes, half the resolution and the rim blur it.
        const double z = truth.normals[static_cast<std::size_t>(2 * kHalf * kHalf + i)];
        if (z > 0.5) {
          EXPECT_NEAR(z, (place - middle_of(asset)).normalized().dot(back), 0.12);
        }
      }
      // The picture is the ball's box with a fifth around it: a disc of the diameter 1 / 1.2.
      EXPECT_NEAR(known, 0.785 / 1.44 * kHalf * kHalf, 0.08 * kHalf * kHalf);
    }
  }
}

TEST_F(Balls, MissingDepthsAreNamed) {
  std::filesystem::remove(views(0) / "000_depth.png");
  bool thrown = false;
  for (std::uint64_t draw = 0; draw < 40 && !thrown; ++draw) {
    Rng rng(11, "draw", draw);
    try {
      data::read_picture_truth(views(0), 32, rng);
    } catch (const InputError& error) {
      thrown = true;
      EXPECT_NE(std::string(error.what()).find("000_depth.png"), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find("--view-geometry"), std::string::npos) << error.what();
    }
  }
  EXPECT_TRUE(thrown);
}

TEST_F(Balls, ItLearnsAndItsEstimateConditionsAnEncoder) {
  train(test::train_command(folder_, "run"));
  const CsvTable metrics = read_csv(folder_ / "run/metrics.csv");
  const auto values = [&](const char* column) {  // losses and evaluations are in rows of their own
    std::vector<double> found;
    for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
      if (!metrics.cell(row, column).empty()) found.push_back(std::stod(metrics.cell(row, column)));
    }
    return found;
  };
  for (const char* term : {"loss.normals", "loss.coordinates", "loss.camera", "loss.family"}) {
    const std::vector<double> losses = values(term);
    ASSERT_EQ(losses.size(), 3u) << term;
    // The family, which weighs a fifth, is learned last.
    EXPECT_LT(losses.back(), (std::string(term) == "loss.family" ? 1.0 : 0.8) * losses.front()) << term;
  }
  ASSERT_EQ(values("eval.yaw").size(), 1u);
  EXPECT_GT(values("eval.yaw").front(), 0.0);

  const Json trainer{{"image_encoder",
                      {{"name", "patch"},
                       {"image_size", 32},
                       {"patch_size", 8},
                       {"width", 32},
                       {"num_blocks", 1},
                       {"num_heads", 2},
                       {"stem", "convolutions"},
                       {"estimator", (folder_ / "run").string()},
                       {"lift", 3}}}};
  ConfigReader reader(trainer, "test");
  const auto encoder = vision::make_condition_encoder(reader, 32, 24, torch::kCPU);
  const Tensor pictures = torch::rand({2, 3, 32, 32});
  const Tensor tokens = encoder->tokens(pictures);
  EXPECT_EQ(tokens.sizes(), (std::vector<std::int64_t>{2, 16 + 27, 24}));
  EXPECT_TRUE(tokens.isfinite().all().item<bool>());
  EXPECT_TRUE(tokens.requires_grad());
  EXPECT_TRUE(encoder->replica()->tokens(pictures).equal(tokens));
}

TEST_F(Balls, AConfigThatDoesNotFitIsRefused) {
  for (const char* wrong : {"models.estimator.args.families=3", "models.estimator.args.image_size=48",
                            "models.estimator.args.width=60", "dataset.args.image_size=33"})
    EXPECT_THROW(train(test::train_command(folder_, "wrong", {wrong})), InputError) << wrong;
}

}  // namespace
}  // namespace anigen::train
