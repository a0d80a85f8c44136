#include "anigen/core/json.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"

namespace anigen {
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

}  // namespace
}  // namespace anigen
