#include "anigen/core/config_fields.h"

#include <gtest/gtest.h>

namespace {

using namespace anigen;

enum class Norm { kL1, kL2 };

struct InnerOptions : JsonOptions<InnerOptions> {
  std::int64_t depth = 4;
  void fields(ConfigFields& f) { f("depth", depth, {1, 64}); }
};

struct OuterOptions : JsonOptions<OuterOptions> {
  std::vector<std::int64_t> channels;
  double ratio = 0.5;
  bool on = true;
  std::string mode = "a";
  Norm norm = Norm::kL2;
  std::size_t workers = 2;
  std::int64_t heads = 0;
  std::optional<std::vector<std::int64_t>> widths;
  InnerOptions inner;
  bool flag = false;
  std::filesystem::path file = "x";

  void fields(ConfigFields& f) {
    f("channels", channels, kRequired);
    f("ratio", ratio, {0.0, 1.0});
    f("on", on);
    f("mode", mode, {"a", "b"});
    f("norm", norm, {{"l1", Norm::kL1}, {"l2", Norm::kL2}});
    f("workers", workers, {0, 8});
    f.or_null("heads", heads, {1, 16});
    f("widths", widths);
    f.object("inner", inner);
    f.object("switches", [this](ConfigFields& g) { g("flag", flag); });
    f("file", file);
    f.unused("old");
  }
  void validate(const std::string& file_name = "", const std::string& pointer = "") const {
    if (channels.empty()) throw InputError(file_name, pointer + "/channels", "must not be empty");
  }
};

std::string message_of(const Json& json) {
  try {
    OuterOptions::from_json(json, "f.json", "/args");
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(ConfigFields, ReadsWhatItWrites) {
  const Json json = {{"channels", {8, 16}},
                     {"ratio", 0.25},
                     {"on", false},
                     {"mode", "b"},
                     {"norm", "l1"},
                     {"workers", 3},
                     {"heads", 4},
                     {"widths", {1, 2}},
                     {"inner", {{"depth", 7}}},
                     {"switches", {{"flag", true}}},
                     {"file", "y"}};
  const OuterOptions options = OuterOptions::from_json(json);
  EXPECT_EQ(options.channels, (std::vector<std::int64_t>{8, 16}));
  EXPECT_EQ(options.norm, Norm::kL1);
  EXPECT_EQ(options.workers, 3u);
  EXPECT_EQ(options.inner.depth, 7);
  EXPECT_TRUE(options.flag);
  EXPECT_EQ(options.to_json(), json);
}

TEST(ConfigFields, AbsentIsTheDefaultAndNullIsUnset) {
  const OuterOptions options = OuterOptions::from_json({{"channels", {8}}, {"heads", nullptr}, {"old", 1}});
  EXPECT_EQ(options.ratio, 0.5);
  EXPECT_EQ(options.norm, Norm::kL2);
  EXPECT_EQ(options.inner.depth, 4);
  EXPECT_FALSE(options.widths.has_value());
  const Json written = options.to_json();
  EXPECT_TRUE(written["heads"].is_null() && written["widths"].is_null());
  EXPECT_FALSE(written.contains("old"));
}

TEST(ConfigFields, RefusesAsTheReaderDoes) {
  EXPECT_EQ(message_of(Json::object()), "f.json: /args: the key 'channels' is missing");
  EXPECT_EQ(message_of({{"channels", Json::array()}}), "f.json: /args/channels: must not be empty");
  EXPECT_EQ(message_of({{"channels", {8}}, {"inner", {{"depht", 7}}}}),
            "f.json: /args/inner: unknown key 'depht'; did you mean 'depth'?");
  EXPECT_EQ(message_of({{"channels", {8}}, {"norm", "l3"}}), "f.json: /args/norm: expected one of l1, l2; found 'l3'");
  EXPECT_EQ(message_of({{"channels", {8}}, {"workers", 9}}),
            "f.json: /args/workers: expected an integer from 0 to 8, found 9");
}

TEST(ConfigFields, SeveralReadersShareOneObject) {
  const Json json = {{"channels", {8}}, {"depth", 2}};
  ConfigReader reader(json, "f.json");
  EXPECT_EQ(OuterOptions::read(reader).channels.size(), 1u);
  EXPECT_EQ(InnerOptions::read(reader).depth, 2);
  EXPECT_NO_THROW(reader.finish());
}

TEST(ConfigFields, ARecordDescribesWhatTheyRead) {
  const ConfigRecord record;
  OuterOptions::from_json({{"channels", {8}}, {"heads", 4}});
  const Json& schema = record.schema();
  EXPECT_EQ(schema["required"], Json({"channels"}));
  EXPECT_EQ(schema["additionalProperties"], false);
  const Json& of = schema["properties"];
  EXPECT_EQ(of["channels"]["type"], "array");
  EXPECT_EQ(of["channels"]["items"], (Json{{"type", "integer"}}));
  EXPECT_EQ(of["ratio"], (Json{{"type", "number"}, {"minimum", 0.0}, {"maximum", 1.0}, {"default", 0.5}}));
  EXPECT_EQ(of["norm"]["enum"], (Json{"l1", "l2"}));
  EXPECT_EQ(of["inner"]["properties"]["depth"]["default"], 4);
}

}  // namespace
