#include "anigen/train/trainer_options.h"

#include <gtest/gtest.h>

#include "anigen/core/config_reader.h"
#include "anigen/core/error.h"

namespace anigen::train {
namespace {

TrainerOptions options_with(const std::string& changes) {
  Json json = Json::parse(R"({"max_steps": 200, "batch_size": 4, "optimizer": {"name": "AdamW", "args": {"lr": 1}}})");
  json.update(Json::parse(changes));
  ConfigReader reader(json, "config.json");
  return TrainerOptions::read(reader);
}

TEST(TrainerOptions, IntervalsMayBeSharesOfAllSteps) {
  const TrainerOptions options = options_with(R"({"i_eval": "25%", "i_save": "100%", "i_print": 7, "i_sample": -1})");
  EXPECT_EQ(options.i_eval, 50);
  EXPECT_EQ(options.i_save, 200);
  EXPECT_EQ(options.i_print, 7);
  EXPECT_EQ(options.i_sample, -1);
  EXPECT_EQ(options_with(R"({"i_eval": "0.1%"})").i_eval, 1) << "a share is never none";
  EXPECT_EQ(options_with(R"({"i_eval": 0})").i_eval, 0) << "never";
  EXPECT_THROW(options_with(R"({"i_eval": "often"})"), InputError);
  EXPECT_THROW(options_with(R"({"i_save": -1})"), InputError);
}

}  // namespace
}  // namespace anigen::train
