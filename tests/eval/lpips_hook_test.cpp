// The place where a learned distance enters the evaluation; the network itself is tested in tests/models and
// tests/pipeline.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"
#include "anigen/eval/comparison/evaluate_command.h"
#include "anigen/eval/comparison/run_comparison.h"
#include "tests/support/paths.h"
#include "tests/support/rig_files.h"

namespace anigen::eval {
namespace {

Json weights(const std::string& hash) {
  Json description;
  description["weights_sha256"] = Json::array({hash});
  return description;
}

class LpipsHookTest : public ::testing::Test {
 protected:
  LpipsHookTest() {
    test::write_glb(folder_ / "truth.glb", {});
    test::write_glb(folder_ / "same.glb", {});
  }

  EvaluationRequest request(const Json& description) {
    EvaluationRequest request;
    request.predictions = {(folder_ / "same.glb").string()};
    request.truth = folder_ / "truth.glb";
    request.out = folder_ / "out";
    request.settings.groups = {"image"};
    request.settings.alignment.registration.rotations = 0;
    request.settings.image_size = 32;
    request.report = false;
    request.settings.lpips = description;
    if (!description.is_null()) {
      request.perceptual = [this](const io::Image& a, const io::Image& b) {
        ++calls_;
        EXPECT_EQ(a.width, 32);
        EXPECT_EQ(b.height, 32);
        return 0.25;
      };
    }
    return request;
  }

  Json metrics() { return read_json(folder_ / "out" / "metrics.json"); }

  test::TemporaryFolder folder_;
  std::atomic<int> calls_{0};
};

TEST_F(LpipsHookTest, WithoutWeightsIsReportedAsNotComputed) {
  const Comparison comparison = run_evaluation(request(nullptr));
  ASSERT_EQ(comparison.results[0][0].failure, "");
  EXPECT_TRUE(std::isfinite(comparison.results[0][0].value("psnr")));
  EXPECT_EQ(comparison.results[0][0].not_computed.at("lpips"), "no weights given");
  EXPECT_EQ(metrics()["assets"][0]["not_computed"]["lpips"], "no weights given");
  EXPECT_TRUE(metrics()["summary"]["lpips"]["mean"].is_null());
  EXPECT_TRUE(metrics()["settings"]["lpips"].is_null());
}

TEST_F(LpipsHookTest, WithWeightsIsTheMeanOverTheViewsAndNamesItsWeights) {
  const Json description = weights("aa");
  const Comparison comparison = run_evaluation(request(description));
  EXPECT_EQ(calls_, 4) << "one per view";
  EXPECT_DOUBLE_EQ(comparison.results[0][0].value("lpips"), 0.25);
  EXPECT_DOUBLE_EQ(metrics()["summary"]["lpips"]["mean"].get<double>(), 0.25);
  EXPECT_EQ(metrics()["settings"]["lpips"], description);
}

TEST_F(LpipsHookTest, SavedResultsCountOnlyForTheSameWeights) {
  run_evaluation(request(weights("aa")));
  run_evaluation(request(weights("aa")));
  EXPECT_EQ(calls_, 4) << "the second run resumes";
  run_evaluation(request(weights("cc")));
  EXPECT_EQ(calls_, 8);
  EXPECT_EQ(run_evaluation(request(nullptr)).results[0][0].values.count("lpips"), 0u);
}

TEST_F(LpipsHookTest, ADistanceWithoutADescriptionIsRefused) {
  EvaluationRequest nameless = request(weights("aa"));
  nameless.settings.lpips = nullptr;
  EXPECT_THROW(run_evaluation(nameless), Error);
}

}  // namespace
}  // namespace anigen::eval
