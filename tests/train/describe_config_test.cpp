#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/train/train_command.h"
#include "tests/support/paths.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

std::vector<fs::path> shipped_configs() {
  std::vector<fs::path> files;
  for (const char* folder : {"published", "paper", "tiny", "tiny32", "small", "anymate_tiny", "rignet_tiny"}) {
    for (const auto& entry : fs::directory_iterator(test::source_dir() / "configs" / folder))
      if (entry.path().extension() == ".json") files.push_back(entry.path());
  }
  return files;
}

TrainCommand command_of(const fs::path& config) {
  TrainCommand command;
  command.config = config;
  return command;
}

// Reads every shipped config without a dataset and without building its models.
TEST(DescribeConfig, SchemaOfEveryShippedConfigNamesItsKeys) {
  for (const fs::path& file : shipped_configs()) {
    SCOPED_TRACE(file.string());
    const Json schema = describe_config(command_of(file), ConfigView::kSchema);
    const Json trainer = schema.at("/properties/trainer/properties/args/properties"_json_pointer);
    EXPECT_EQ(trainer.at("seed").at("type"), "integer");
    EXPECT_EQ(trainer.at("seed").at("default"), 0);
    EXPECT_TRUE(trainer.contains("max_steps"));
    const Json config = load_config(file);
    for (const auto& [key, value] : config.at("trainer").at("args").items())
      EXPECT_TRUE(trainer.contains(key)) << "trainer/args/" << key;
    const Json models = schema.at("/properties/models/properties"_json_pointer);
    for (const auto& [name, model] : config.at("models").items()) {
      const Json args = models.at(name).at("properties").at("args").value("properties", Json::object());
      for (const auto& [key, value] : model.at("args").items())
        EXPECT_TRUE(args.contains(key)) << name << "/args/" << key;
    }
  }
}

TEST(DescribeConfig, FullConfigHasEveryDefaultAndReadsAsTheSame) {
  const test::TemporaryFolder folder;
  TrainCommand command = command_of(test::source_dir() / "configs/tiny/skin_ae.json");
  command.overrides = {"trainer.args.max_steps=7"};
  command.data_dir = "data/here";
  const Json full = describe_config(command, ConfigView::kFull);
  EXPECT_EQ(full["trainer"]["args"]["max_steps"], 7);
  EXPECT_EQ(full["trainer"]["args"]["seed"], 0);
  EXPECT_EQ(full["trainer"]["args"]["num_workers_dl"], 1);
  EXPECT_EQ(full["dataset"]["args"]["data_dir"], "data/here");
  EXPECT_TRUE(full["models"]["model"]["args"]["decoder_config"].contains("num_heads")) << full.dump(1);
  write_config(folder / "full.json", full);
  EXPECT_EQ(describe_config(command_of(folder / "full.json"), ConfigView::kFull), full);
}

TEST(DescribeConfig, RefusesWhatTrainingWouldRefuse) {
  TrainCommand command = command_of(test::source_dir() / "configs/tiny/skin_ae.json");
  command.overrides = {"models.model.args.decoder_config.num_blokcs=3"};
  try {
    describe_config(command, ConfigView::kFull);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("num_blocks"), std::string::npos) << error.what();
  }
}

}  // namespace
}  // namespace anigen::train
