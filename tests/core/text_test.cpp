#include "anigen/core/text.h"

#include <gtest/gtest.h>

namespace anigen {

TEST(LowerCase, ChangesAsciiLettersAlone) {
  EXPECT_EQ(lower_case("Bone.L_07 [Z]"), "bone.l_07 [z]");
  EXPECT_EQ(lower_case("ÄÖ"), "ÄÖ");
  EXPECT_EQ(lower_case(""), "");
}

TEST(ReplaceAll, DoesNotSearchWhatItPutIn) {
  std::string text = "aXaXa";
  replace_all(text, "a", "aa");
  EXPECT_EQ(text, "aaXaaXaa");
  replace_all(text, "Y", "Z");
  EXPECT_EQ(text, "aaXaaXaa");
  replace_all(text, "X", "");
  EXPECT_EQ(text, "aaaaaa");
}

TEST(ReplacedCharacters, OneByOne) {
  EXPECT_EQ(replaced_characters("a<b&c", {{'&', "&amp;"}, {'<', "&lt;"}}), "a&lt;b&amp;c");
  EXPECT_EQ(replaced_characters("&", {{'&', "<&>"}, {'<', "no"}}), "<&>") << "what was put in is not replaced again";
}

TEST(Joined, WordsAndNumbersWithASeparator) {
  EXPECT_EQ(joined(std::vector<std::string>{"a", "", "b"}), "a, , b");
  EXPECT_EQ(joined(std::vector<int>{1, -2}, " "), "1 -2");
  EXPECT_EQ(joined(std::set<std::string>{}), "");
  const std::vector<std::pair<int, const char*>> items = {{1, "one"}, {2, "two"}};
  EXPECT_EQ(joined(items, "; ", &std::pair<int, const char*>::second), "one; two");
  EXPECT_EQ(joined(items, "+", [](const auto& item) { return std::to_string(2 * item.first); }), "2+4");
}

TEST(Listed, NamesTheFirstFewAndCountsTheOthers) {
  EXPECT_EQ(listed(std::vector<std::string>{"c", "b", "a"}), "c, b, a");
  EXPECT_EQ(listed({"d", "c", "b", "a"}), "a, b, c and 1 more");
  EXPECT_EQ(listed(std::vector<std::string>{"a", "b", "c"}, 1), "a and 2 more");
  EXPECT_EQ(listed(std::vector<std::string>{}), "");
}

namespace {

enum class Fruit { kApple, kPear };
const Words<Fruit> kFruits = {{Fruit::kApple, "apple"}, {Fruit::kPear, "pear"}};

TEST(Words, ThereAndBack) {
  for (const auto& [fruit, word] : kFruits) {
    EXPECT_EQ(word_of(kFruits, fruit), word);
    EXPECT_EQ(value_of(kFruits, word, "--fruit"), fruit);
  }
}

TEST(Words, AnUnknownOneNamesThePlaceAndTheKnownOnes) {
  try {
    value_of(kFruits, "plum", "--fruit");
    ADD_FAILURE() << "accepted";
  } catch (const InputError& error) {
    EXPECT_EQ(error.place(), "--fruit");
    EXPECT_EQ(error.problem(), "'plum' is none of apple, pear");
  }
}

}  // namespace

}  // namespace anigen
