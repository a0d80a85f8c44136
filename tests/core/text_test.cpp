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

}  // namespace anigen
