#include "anigen/core/config_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

class ConfigFile : public ::testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }
  Json load(const std::string& name) { return load_config(folder_ / name); }
  std::string error_of(const std::string& name) {
    try {
      load(name);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

TEST_F(ConfigFile, ChildOverridesKeyByKeyAndKeepsTheRest) {
  write("base.json", R"({"trainer": {"name": "T", "args": {"lr": 1, "steps": 5, "list": [1, 2]}}, "other": 3})");
  write("child.json", R"({"extends": "base.json", "trainer": {"args": {"lr": 2, "list": [9]}}})");
  const Json expected =
      Json::parse(R"({"trainer": {"name": "T", "args": {"lr": 2, "steps": 5, "list": [9]}}, "other": 3})");
  EXPECT_EQ(load("child.json"), expected);
}

TEST_F(ConfigFile, ExtendsIsRelativeToTheFileThatSaysItAndMayChain) {
  std::filesystem::create_directories(folder_ / "deep");
  write("root.json", R"({"a": 1, "b": 1, "c": 1})");
  write("deep/middle.json", R"({"extends": "../root.json", "b": 2, "c": 2})");
  write("leaf.json", R"({"extends": ["deep/middle.json"], "c": 3})");
  EXPECT_EQ(load("leaf.json"), Json::parse(R"({"a": 1, "b": 2, "c": 3})"));
}

TEST_F(ConfigFile, AnotherNameReplacesTheWholeObject) {
  write("base.json", R"({"optimizer": {"name": "AdamW", "args": {"lr": 1, "betas": [0, 1]}}})");
  write("child.json", R"({"extends": "base.json", "optimizer": {"name": "SGD", "args": {"lr": 2}}})");
  EXPECT_EQ(load("child.json")["optimizer"]["args"], Json::parse(R"({"lr": 2})"));
}

TEST_F(ConfigFile, CyclesLongChainsAndWrongTypesAreErrors) {
  write("a.json", R"({"extends": "b.json"})");
  write("b.json", R"({"extends": "a.json"})");
  EXPECT_NE(error_of("a.json").find("cycle"), std::string::npos);
  for (int i = 0; i < 20; ++i) {
    write("chain" + std::to_string(i) + ".json", R"({"extends": "chain)" + std::to_string(i + 1) + R"(.json"})");
  }
  EXPECT_NE(error_of("chain0.json").find("chain of more than 16"), std::string::npos);
  write("number.json", R"({"extends": 3})");
  EXPECT_NE(error_of("number.json").find("/extends"), std::string::npos);
  write("list.json", "[1]");
  EXPECT_NE(error_of("list.json").find("JSON object"), std::string::npos);
  write("missing.json", R"({"extends": "nowhere.json"})");
  EXPECT_NE(error_of("missing.json").find("nowhere.json"), std::string::npos);
}

TEST(ConfigOverride, ValuesAreJsonElseText) {
  Json config = Json::parse(R"({"trainer": {"args": {"lr": 1}}, "list": [{"a": 1}, {"a": 2}]})");
  apply_overrides(config, {"trainer.args.lr=1e-3", "trainer.args.mode=paper", "trainer.args.on=true",
                           "trainer.args.rates=[0.9,0.99]", "list.1.a=5", "new.path.key=x=y", "empty="});
  EXPECT_EQ(config["trainer"]["args"]["lr"], 1e-3);
  EXPECT_EQ(config["trainer"]["args"]["mode"], "paper");
  EXPECT_EQ(config["trainer"]["args"]["on"], true);
  EXPECT_EQ(config["trainer"]["args"]["rates"].size(), 2u);
  EXPECT_EQ(config["list"][1]["a"], 5);
  EXPECT_EQ(config["list"][0]["a"], 1);
  EXPECT_EQ(config["new"]["path"]["key"], "x=y");
  EXPECT_EQ(config["empty"], "");
}

TEST(ConfigOverride, ImpossiblePathsAreErrors) {
  Json config = Json::parse(R"({"number": 3, "list": [1]})");
  for (const char* bad : {"novalue", "=3", "number.x=1", "list.1=2", "list.x=2", "list.99999999999999999999=2",
                          "a..b=1", ".a=1", "a.=1"}) {
    EXPECT_THROW(apply_override(config, bad), InputError) << bad;
  }
}

TEST(ConfigOverride, WrittenConfigReadsBackEqual) {
  const test::TemporaryFolder folder;
  const Json config = Json::parse(R"({"z": 1, "a": {"lr": 1e-4, "text": "ü\n"}, "list": []})");
  write_config(folder / "run/config.json", config);
  const Json back = load_config(folder / "run/config.json");
  EXPECT_EQ(back, config);
  EXPECT_EQ(back.begin().key(), "z") << "order of keys decides the order of models and must survive";
}

}  // namespace
}  // namespace anigen
