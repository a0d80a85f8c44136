#include "anigen/data/rigged_item.h"

#include <gtest/gtest.h>

#include <limits>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npz.h"
#include "tests/data/synthetic_dataset.h"
#include "tests/support/paths.h"

namespace anigen::data {
namespace {

class RiggedItemFile : public ::testing::Test {
 protected:
  RiggedItem read(const io::NamedArrays& arrays) {
    io::write_npz(test::rig_file(folder_.path(), "x"), arrays);
    return read_rigged_item({folder_.path(), "x"});
  }
  // Error after one array was replaced.
  std::string error_with(const std::string& name, const io::NdArray& array) {
    io::NamedArrays arrays = test::synthetic_rig(1, 5);
    for (auto& entry : arrays) {
      if (entry.first == name) entry.second = array;
    }
    try {
      read(arrays);
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

TEST_F(RiggedItemFile, ReadsWhatWasWritten) {
  const io::NamedArrays arrays = test::synthetic_rig(1, 5);
  const RiggedItem item = read(arrays);
  ASSERT_EQ(item.joints.size(), 5u);
  ASSERT_EQ(item.vertices.size(), 80u);
  EXPECT_EQ(item.faces.size(), 128u);
  const std::vector<float> skin = io::find(arrays, "skin")->as<float>(), back = to_dense(item.skin, 5);
  for (std::size_t i = 0; i < skin.size(); ++i) EXPECT_NEAR(back[i], skin[i], 1e-6f);
  EXPECT_LE(item.skin.influences.size(), 160u) << "two influences at most per vertex";
}

TEST_F(RiggedItemFile, RowsWithoutWeightGoToJointZeroAndOthersAreNormalised) {
  io::NamedArrays arrays = test::synthetic_rig(1, 5);
  std::vector<float> skin = io::find(arrays, "skin")->as<float>();
  std::fill_n(skin.begin(), 5, 0.0f);
  for (int j = 0; j < 5; ++j) skin[static_cast<std::size_t>(5 + j)] = j == 2 ? 3.0f : j == 4 ? 1.0f : 0.0f;
  arrays[2].second = io::NdArray::from(skin, {80, 5});
  const RiggedItem item = read(arrays);
  EXPECT_EQ(item.unweighted, 1u);
  const std::vector<float> dense = to_dense(item.skin, 5);
  EXPECT_EQ(dense[0], 1.0f);
  EXPECT_EQ(dense[5 + 2], 0.75f);
  EXPECT_EQ(dense[5 + 4], 0.25f);
}

TEST_F(RiggedItemFile, BadContentsNameArrayAndIndex) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  std::vector<float> skin(80 * 5, 0.2f);
  skin[7] = nan;
  EXPECT_NE(error_with("skin", io::NdArray::from(skin, {80, 5})).find("skin[1, 2]"), std::string::npos);
  skin[7] = -0.1f;
  EXPECT_NE(error_with("skin", io::NdArray::from(skin, {80, 5})).find("skin[1, 2]"), std::string::npos);
  EXPECT_NE(error_with("skin", io::NdArray::from(skin, {40, 10})).find("shape [40, 10]"), std::string::npos);
  EXPECT_NE(error_with("joints", io::NdArray::from(std::vector<float>(15, nan), {5, 3})).find("joints[0]"),
            std::string::npos);
  using Ints = std::vector<std::int64_t>;
  EXPECT_NE(error_with("parents", io::NdArray::from(Ints{-1, 0, 9, 0, 0}, {5})).find("parents[2]"), std::string::npos);
  EXPECT_NE(error_with("parents", io::NdArray::from(Ints{-1, 0, -7, 0, 0}, {5})).find("parents[2]"), std::string::npos);
  EXPECT_NE(error_with("parents", io::NdArray::from(Ints{-1, 2, 3, 1, 0}, {5})).find("cycle"), std::string::npos);
  EXPECT_NE(error_with("parents", io::NdArray::from(Ints{1, 0, 0, 0, 0}, {5})).find("cycle"), std::string::npos)
      << "no root";
  EXPECT_NE(error_with("faces", io::NdArray::from(Ints{0, 1, 80}, {1, 3})).find("faces[0]"), std::string::npos);
  EXPECT_NE(error_with("faces", io::NdArray::from(Ints{}, {0, 3})).find("faces"), std::string::npos);
  EXPECT_NE(error_with("faces", io::NdArray::from(Ints{0, 1, 2}, {3})).find("shape [3]"), std::string::npos);
}

TEST_F(RiggedItemFile, MissingFileOrArrayIsNamed) {
  EXPECT_THROW(read_rigged_item({folder_.path(), "absent"}), InputError);
  io::NamedArrays arrays = test::synthetic_rig(1, 5);
  arrays.erase(arrays.begin() + 1);
  EXPECT_THROW(read(arrays), InputError);
}

TEST(ParentsFirst, OrdersAnyTree) {
  EXPECT_EQ(parents_first_order({2, 0, -1, 1}, ""), (std::vector<int>{2, 0, 1, 3}));
  EXPECT_EQ(parents_first_order({-1, -1, 1, 0}, ""), (std::vector<int>{0, 1, 2, 3}));
}

}  // namespace
}  // namespace anigen::data
