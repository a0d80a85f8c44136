#include "anigen/core/config_reader.h"

#include <gtest/gtest.h>

namespace anigen {
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
}  // namespace anigen
