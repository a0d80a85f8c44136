#include "anigen/io/gltf/json_text.h"

#include <gtest/gtest.h>

#include "anigen/core/config.h"

namespace anigen::io::gltf_import {

namespace {

constexpr std::string_view kJsonText = R"(
 { "a" : [ 1.50e1 , {"x":"]}\""} , [] ],
   "b":{"c":-0.0,"d\u0065":null} , "empty":{ }, "a2":true } )";

TEST(JsonText, FindsValuesAsTheyStand) {
  const JsonText text(kJsonText);
  const auto a = text.find(text.root(), "a");
  ASSERT_TRUE(a);
  const auto elements = text.elements(*a);
  ASSERT_EQ(elements.size(), 3u);
  EXPECT_EQ(text.text(elements[0]), "1.50e1");
  EXPECT_EQ(text.text(elements[1]), R"({"x":"]}\""})");
  EXPECT_EQ(text.text(elements[2]), "[]");
  EXPECT_TRUE(text.elements(elements[2]).empty());
  EXPECT_EQ(text.text(*text.find_below(text.root(), {"b", "de"})), "null") << "keys may have escapes";
  EXPECT_EQ(text.text(*text.find(text.root(), "a2")), "true");
  EXPECT_FALSE(text.find(text.root(), "x"));
  EXPECT_FALSE(text.find_below(text.root(), {"empty", "b"}));
}

TEST(JsonText, OfRepeatedMembersTheLastCounts) {
  const JsonText text(R"({"a":1,"a":2})");
  EXPECT_EQ(text.text(*text.find(text.root(), "a")), "2");
  EXPECT_EQ(Json::parse(R"({"a":1,"a":2})")["a"], 2);
}

TEST(JsonText, WithoutChangesItIsTheText) { EXPECT_EQ(JsonText(kJsonText).edited(), kJsonText); }

TEST(JsonText, ChangesLeaveTheRestAsItIs) {
  JsonText text(kJsonText);
  const auto a = *text.find(text.root(), "a");
  text.append(a, {"7", "8"});
  text.append(text.elements(a)[2], {"9"});
  text.set(text.root(), "a2", "false");
  text.set(text.root(), "new", "[]");
  text.set(*text.find(text.root(), "empty"), "p", "1");
  text.set(*text.find(text.root(), "empty"), "q", "2");
  text.replace_member(*text.find(text.root(), "b"), "de", R"("e":4,"f":5)");
  EXPECT_EQ(text.edited(), R"(
 { "a" : [ 1.50e1 , {"x":"]}\""} , [9] ,7,8],
   "b":{"c":-0.0,"e":4,"f":5} , "empty":{ "p":1,"q":2}, "a2":false ,"new":[]} )");
}

TEST(JsonText, MembersGoWithTheirComma) {
  for (const auto& [key, rest] : {std::pair{"a", R"({"b":2, "c":3})"},
                                  {"b", R"({"a":1 ,"c":3})"},
                                  {"c", R"({"a":1 ,"b":2})"},
                                  {"d", R"({"a":1 ,"b":2, "c":3})"}}) {
    JsonText text(R"({"a":1 ,"b":2, "c":3})");
    text.erase(text.root(), key);
    EXPECT_EQ(text.edited(), rest) << key;
  }
}

TEST(JsonText, AByteOrderMarkGoes) {
  const std::string marked = "\xEF\xBB\xBF{\"a\":1}";
  JsonText text(marked);
  text.set(text.root(), "b", "2");
  EXPECT_EQ(text.edited(), R"({"a":1,"b":2})");
}

// Text that was cut off is never read beyond its end.
TEST(JsonText, StaysInsideAnyText) {
  for (std::size_t size = 0; size <= kJsonText.size(); ++size) {
    const std::string cut(kJsonText.substr(0, size));
    const JsonText text(cut);
    EXPECT_LE(text.root().end, cut.size());
    for (const auto& element : text.elements(text.root())) EXPECT_LE(element.end, cut.size());
  }
}

}  // namespace

}  // namespace anigen::io::gltf_import
