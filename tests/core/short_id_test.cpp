#include "anigen/core/short_id.h"

#include <gtest/gtest.h>

namespace anigen {
namespace {

TEST(ShortId, KeepsNamesAndShortensHashes) {
  EXPECT_EQ(short_id("post0"), "post0");
  EXPECT_EQ(short_id("028b880bf2df64237748d1173d6df1eaa1b23b3c01d35e936c3b76cf032cb35b"), "028b880b");
  EXPECT_EQ(short_id(""), "");
}

}  // namespace
}  // namespace anigen
