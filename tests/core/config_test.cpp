#include <gtest/gtest.h>
#include <fstream>

#include "anigen/core/config.h"
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

namespace {

// The message of the InputError that the action must throw.
template <typename Action>
std::string message_of(Action action) {
  try {
    action();
  } catch (const InputError& error) {
    return error.what();
  }
  ADD_FAILURE() << "no InputError";
  return "";
}

TEST(ConfigReader, ReadsValuesAndFallsBack) {
  const Json json = Json::parse(R"({"n": 3, "x": 2, "on": true, "name": "a", "sizes": [1, 2], "inner": {"k": 5}})");
  ConfigReader reader(json, "f.json");
  EXPECT_EQ(reader.integer("n", 7), 3);
  EXPECT_EQ(reader.integer("absent", 7), 7);
  EXPECT_EQ(reader.number("x", 0.5), 2.0);  // an integer is a number
  EXPECT_TRUE(reader.boolean("on", false));
  EXPECT_EQ(reader.text("name", ""), "a");
  EXPECT_EQ(reader.integers("sizes", {}), (std::vector<std::int64_t>{1, 2}));
  EXPECT_EQ(reader.object("inner").integer("k", 0), 5);
  EXPECT_EQ(reader.object("no_such_object").integer("k", 4), 4);
  EXPECT_NO_THROW(reader.finish());
}

TEST(ConfigReader, UnknownKeyNamesTheNearest) {
  const Json json = Json::parse(R"({"detph": 3})");
  ConfigReader reader(json, "f.json", "/models/model/args");
  reader.integer("depth", 4);
  reader.boolean("use_fp16", false);
  const std::string message = message_of([&] { reader.finish(); });
  EXPECT_EQ(message, "f.json: /models/model/args: unknown key 'detph'; did you mean 'depth'?");
}

TEST(ConfigReader, UnknownKeyUnlikeAnyOtherListsTheKnown) {
  const Json json = Json::parse(R"({"zzzzzzzz": 3})");
  ConfigReader reader(json, "f.json");
  reader.integer("depth", 4);
  reader.boolean("use_fp16", false);
  EXPECT_NE(message_of([&] { reader.finish(); }).find("known keys are depth, use_fp16"), std::string::npos);
}

TEST(ConfigReader, WrongTypesNameThePointer) {
  const Json json = Json::parse(R"({"a/b": 1.5, "s": 1, "list": [1, "x"], "big": 18446744073709551615, "null": null})");
  ConfigReader reader(json, "f.json", "/trainer");
  EXPECT_NE(message_of([&] { reader.integer("a/b", 0); }).find("f.json: /trainer/a~1b: expected an integer"),
            std::string::npos);
  EXPECT_NE(message_of([&] { reader.text("s", ""); }).find("/trainer/s"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.integers("list", {}); }).find("/trainer/list/1"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.integer("big", 0); }).find("/trainer/big"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.boolean("null", true); }).find("/trainer/null"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.object("s"); }).find("/trainer/s: expected an object"), std::string::npos);
}

TEST(ConfigReader, RangesAndChoices) {
  const Json json = Json::parse(R"({"n": -1, "x": 2.5, "mode": "swim"})");
  ConfigReader reader(json, "");
  EXPECT_NE(message_of([&] { reader.integer("n", 1, 0, 10); }).find("from 0 to 10"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.number("x", 1, 0, 1); }).find("/x"), std::string::npos);
  EXPECT_NE(message_of([&] { reader.choice("mode", "swin", {"swin", "full"}); }).find("swin, full"), std::string::npos);
}

TEST(ConfigReader, RequireNamesTheMissingKey) {
  const Json json = Json::object();
  EXPECT_NE(message_of([&] { ConfigReader(json, "f.json").require("lr"); }).find("'lr'"), std::string::npos);
}

TEST(ConfigReader, RefusesWhatIsNotAnObject) {
  const Json json = Json::array();
  EXPECT_NE(message_of([&] { ConfigReader(json, "f.json", "/models"); }).find("/models: expected an object"),
            std::string::npos);
}

TEST(EditDistance, CountsEdits) {
  EXPECT_EQ(edit_distance("depth", "depth"), 0U);
  EXPECT_EQ(edit_distance("detph", "depth"), 1U);  // a swap of neighbours
  EXPECT_EQ(edit_distance("kitten", "sitting"), 3U);
  EXPECT_EQ(edit_distance("", "abc"), 3U);
}

TEST(NearestWord, IgnoresWordsTooFarAway) {
  EXPECT_EQ(nearest_word("num_head", {"num_blocks", "num_heads"}), "num_heads");
  EXPECT_EQ(nearest_word("colour", {"depth"}), "");
  EXPECT_EQ(nearest_word(std::string(100000, 'a'), {"depth"}), "");
}

}  // namespace

namespace {

TEST(Json, KeepsTheOrderOfKeys) {
  const Json json = parse_json(R"({"z": 1, "a": 2})", "x.json");
  EXPECT_EQ(json.begin().key(), "z");
}

TEST(Json, ErrorsNameFileAndByte) {
  try {
    parse_json("{\"a\": }", "broken.json");
    FAIL() << "accepted broken JSON";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), "broken.json");
    EXPECT_EQ(error.place(), "byte 7");
  }
}

TEST(Json, NumbersBeyondDoubleAreInputErrors) { EXPECT_THROW(parse_json("[1e999]", "big.json"), InputError); }

TEST(Json, RefusesDeepNestingButNotBracketsInStrings) {
  const std::string deep = std::string(10000, '[') + std::string(10000, ']');
  EXPECT_THROW(parse_json(deep, "deep.json"), InputError);
  const std::string text = "[\"" + std::string(10000, '[') + "\\\"[\"]";
  EXPECT_NO_THROW(parse_json(text, "text.json"));
  EXPECT_NO_THROW(parse_json("[[[1]]]", "exact.json", JsonLimits{3}));
  EXPECT_THROW(parse_json("[[[1]]]", "over.json", JsonLimits{2}), InputError);
}

TEST(Json, RefusesMoreValuesThanAllowedBeforeBuildingThem) {
  EXPECT_NO_THROW(parse_json("[1,2,\",,,,\"]", "three.json", JsonLimits{256, 3}));
  try {
    parse_json("[1,2,3,4]", "four.json", JsonLimits{256, 3});
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "byte 6");
    EXPECT_NE(error.problem().find("more than 3 JSON values"), std::string::npos);
  }
}

/// Without the order of keys.
nlohmann::json sorted(const Json& json) { return nlohmann::json::parse(json.dump()); }

TEST(ConfigRecord, IsASchemaOfWhatWasRead) {
  const Json config = Json::parse(R"({"name": "b", "args": {"lr": 0.5}, "form": [1], "list": [{"depth": 2}]})");
  ConfigRecord record;
  ConfigReader reader(config, "c.json");
  reader.require("name");
  reader.choice("name", "", {"a", "b"});
  reader.integer("steps", 7, 1, 9);
  reader.boolean("fast", true);
  reader.texts("words", {"x"});
  reader.raw("form");
  ConfigReader args = reader.object("args");
  args.number("lr", 1.0, 0.0);
  args.number("decay", 0.25);
  args.finish();
  reader.raw("list");
  reader.finish();
  EXPECT_EQ(sorted(record.schema()), nlohmann::json::parse(R"({
    "type": "object", "required": ["name"], "properties": {
      "name": {"type": "string", "enum": ["a", "b"]},
      "steps": {"type": "integer", "minimum": 1, "maximum": 9, "default": 7},
      "fast": {"type": "boolean", "default": true},
      "words": {"type": "array", "items": {"type": "string"}, "default": ["x"]},
      "form": {"$comment": "any form"},
      "args": {"type": "object", "properties": {
        "lr": {"type": "number", "minimum": 0.0, "default": 1.0}, "decay": {"type": "number", "default": 0.25}},
        "additionalProperties": false},
      "list": {"$comment": "any form"}},
    "additionalProperties": false})"))
      << record.schema().dump(1);
  EXPECT_EQ(sorted(record.completed(config)),
            nlohmann::json::parse(R"({"name": "b", "args": {"lr": 0.5, "decay": 0.25}, "form": [1],
    "list": [{"depth": 2}], "steps": 7, "fast": true, "words": ["x"]})"));
}

TEST(ConfigRecord, IsOfReadersWithinItsLifeAlone) {
  const Json config = Json::object();
  ConfigRecord outer;
  {
    ConfigRecord inner;
    ConfigReader(config, "").integer("a", 1);
    EXPECT_TRUE(inner.schema()["properties"].contains("a"));
  }
  ConfigReader(config, "").integer("b", 1);
  EXPECT_EQ(outer.schema()["properties"].size(), 1U);
}

}  // namespace

}  // namespace anigen
