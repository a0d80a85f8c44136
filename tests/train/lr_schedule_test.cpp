#include "anigen/train/lr_schedule.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/train/trainer_options.h"

namespace anigen::train {
namespace {

TEST(LrSchedule, PublishedWarmUpThenCosine) {
  const LrSchedulePtr schedule =
      sequential_lr({linear_lr(1e-6, 1.0, 1000), cosine_annealing_lr(1'000'000, 0.0)}, {1000});
  for (const std::int64_t s : {0, 1, 500, 999}) {
    EXPECT_NEAR(schedule->rate(1e-4, s), 1e-4 * (1e-6 + (1 - 1e-6) * static_cast<double>(s) / 1000.0), 1e-18);
  }
  EXPECT_DOUBLE_EQ(schedule->rate(1e-4, 1000), 1e-4);
  for (const std::int64_t s : {1001, 250'000, 1'000'000}) {
    EXPECT_NEAR(schedule->rate(1e-4, s), 0.5e-4 * (1 + std::cos(kPi * static_cast<double>(s - 1000) / 1e6)), 1e-17);
  }
}

TEST(LrSchedule, CosineComesBackUpAfterTMax) {
  const LrSchedulePtr schedule = cosine_annealing_lr(50, 1e-5);
  EXPECT_NEAR(schedule->rate(3e-4, 50), 1e-5, 1e-18);
  EXPECT_NEAR(schedule->rate(3e-4, 75), schedule->rate(3e-4, 25), 1e-16);
  EXPECT_NEAR(schedule->rate(3e-4, 100), 3e-4, 1e-16);
}

TEST(LrSchedule, StepsDownAtMilestones) {
  const LrSchedulePtr steps = multi_step_lr({10, 4}, 0.2);
  EXPECT_DOUBLE_EQ(steps->rate(2.0, 3), 2.0);
  EXPECT_DOUBLE_EQ(steps->rate(2.0, 4), 0.4);
  EXPECT_DOUBLE_EQ(steps->rate(2.0, 10), 2.0 * 0.2 * 0.2);
}

TEST(LrSchedule, LinearConstantAndWarmUp) {
  EXPECT_DOUBLE_EQ(linear_lr(0.5, 1.0, 10)->rate(2.0, 5), 1.5);
  EXPECT_DOUBLE_EQ(linear_lr(0.5, 0.25, 10)->rate(2.0, 1000), 0.5);
  EXPECT_DOUBLE_EQ(constant_lr(0.1, 3)->rate(2.0, 2), 0.2);
  EXPECT_DOUBLE_EQ(constant_lr(0.1, 3)->rate(2.0, 3), 2.0);
  EXPECT_DOUBLE_EQ(linear_warmup_lr(7)->rate(7.0, 0), 1.0);
  EXPECT_DOUBLE_EQ(linear_warmup_lr(7)->rate(7.0, 6), 7.0);
  EXPECT_DOUBLE_EQ(linear_warmup_lr(7)->rate(7.0, 600), 7.0);
}

TEST(LrSchedule, SeveralMilestonesCountTheirOwnSteps) {
  const LrSchedulePtr schedule =
      sequential_lr({constant_lr(0.5, 100), linear_lr(0.0, 1.0, 10), unscheduled()}, {3, 13});
  EXPECT_DOUBLE_EQ(schedule->rate(1.0, 2), 0.5);
  EXPECT_DOUBLE_EQ(schedule->rate(1.0, 3), 0.0);
  EXPECT_DOUBLE_EQ(schedule->rate(1.0, 8), 0.5);
  EXPECT_DOUBLE_EQ(schedule->rate(1.0, 13), 1.0);
  EXPECT_THROW(sequential_lr({unscheduled()}, {3}), InputError);
  EXPECT_THROW(sequential_lr({unscheduled(), unscheduled(), unscheduled()}, {5, 3}), InputError);
}

TEST(LrSchedule, ReadsJsonAndSharesOfMaxSteps) {
  const Json json = Json::parse(R"({"name": "SequentialLR", "schedulers": [
      {"name": "LinearLR", "args": {"start_factor": 0.1, "total_iters": "10%"}},
      {"name": "CosineAnnealingLR", "args": {"T_max": 90}}], "args": {"milestones": ["10%"]}})");
  const LrSchedulePtr schedule = read_schedule(json, 100, "f", "/s");
  EXPECT_DOUBLE_EQ(schedule->rate(1.0, 0), 0.1);
  EXPECT_DOUBLE_EQ(schedule->rate(1.0, 10), 1.0);
  EXPECT_NEAR(schedule->rate(1.0, 55), 0.5, 1e-12);
}

TEST(LrSchedule, BadJsonNamesThePlace) {
  const auto message = [](const char* text) {
    try {
      read_schedule(Json::parse(text), 100, "f.json", "/s");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  EXPECT_NE(message(R"({"name": "CosineAnnealingLR", "args": {"T_mx": 3}})").find("T_max"), std::string::npos);
  EXPECT_NE(message(R"({"name": "StepLR"})").find("LinearLR"), std::string::npos);
  EXPECT_NE(message(R"({"name": "LinearLR", "args": {"total_iters": "x%"}})").find("/s/args/total_iters"),
            std::string::npos);
  EXPECT_NE(message(R"({"name": "SequentialLR", "schedulers": [], "args": {"milestones": []}})").find("milestones"),
            std::string::npos);
}

}  // namespace
}  // namespace anigen::train
