#include "anigen/core/words.h"

#include <gtest/gtest.h>

namespace anigen {
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
