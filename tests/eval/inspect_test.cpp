#include "anigen/eval/inspect/inspect.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/core/atomic_file.h"
#include "anigen/core/base64.h"
#include "anigen/core/error.h"
#include "anigen/eval/inspect/file_table.h"
#include "anigen/eval/inspect/influence_loss.h"
#include "anigen/eval/line_chart.h"
#include "anigen/io/npz.h"
#include "tests/support/paths.h"

namespace anigen::eval {
namespace {

/// One vertex at (0, 0, 1) that two joints move, of which the second turns by 90° about X at the end of the
/// animation; and two more that set the diagonal of the box to √32.
Asset lever() {
  Asset asset;
  asset.mesh.vertices = {{0, 0, 1}, {0, 0, 0}, {0, 4, 4}};
  asset.mesh.faces = {{0, 1, 2}};
  asset.skeleton = skeleton_from_joints({{0, 0, 0}, {0, 0, 0}}, {-1, 0});
  asset.skin.append_row({{0, 0.6f}, {1, 0.4f}});
  asset.skin.append_row({{0, 1.0f}});
  asset.skin.append_row({{0, 1.0f}});
  Animation turn;
  turn.channels.push_back(
      {1, ChannelPath::kRotation, Interpolation::kLinear, {0, 1}, {0, 0, 0, 1, std::sqrt(0.5), 0, 0, std::sqrt(0.5)}});
  asset.animations.push_back(turn);
  return asset;
}

TEST(InfluenceLoss, MeasuresWeightsAndDisplacement) {
  const InfluenceLoss loss = influence_loss(lever(), 1, 5);
  EXPECT_EQ(loss.affected, 1u);
  EXPECT_EQ(loss.frames, 5u);
  // (0.6, 0.4) becomes (1, 0): 0.8 in one of three vertices.
  EXPECT_NEAR(loss.max_l1, 0.8, 1e-6);
  EXPECT_NEAR(loss.mean_l1, 0.8 / 3, 1e-6);
  // At the end the full vertex is at 0.6·(0,0,1) + 0.4·(0,-1,0), the limited one stays: 0.4·√2 apart.
  EXPECT_NEAR(loss.max_displacement, 0.4 * std::sqrt(2.0) / std::sqrt(32.0), 1e-6);
}

TEST(InfluenceLoss, IsZeroWhenNothingIsDropped) {
  const InfluenceLoss loss = influence_loss(lever(), 2);
  EXPECT_EQ(loss.affected, 0u);
  EXPECT_EQ(loss.max_l1, 0.0);
  EXPECT_EQ(loss.max_displacement, 0.0);
}

TEST(DescribeAsset, CountsWhatIsThere) {
  io::ImportedAsset imported{lever(), {{"zero_weights", "1 vertex"}}};
  const Json json = describe_asset(imported);
  EXPECT_EQ(json["joints"], 2);
  EXPECT_EQ(json["vertices"], 3);
  EXPECT_EQ(json["influences"]["1"], 2);
  EXPECT_EQ(json["influences"]["2"], 1);
  EXPECT_EQ(json["skeleton_depth"], 2);
  EXPECT_EQ(json["animations"][0]["seconds"], 1.0);
  EXPECT_EQ(json["notes"][0]["code"], "zero_weights");
}

TEST(Inspect, TellsKindsApartAndNamesWhatItCannotRead) {
  const test::TemporaryFolder folder;
  io::write_npz(folder / "a.npz", {{"x", io::NdArray::from(std::vector<float>(6), {2, 3})}});
  write_file_atomically(folder / "config.json",
                        R"({"models": {"model": {"name": "SkinAutoEncoder", "args": {}}}, "trainer": {"name": "T"}})");
  write_file_atomically(folder / "data" / "metadata.csv",
                        "sha256,num_joints,is_test\na,3,True\nb,5,False\nc,9,False\n");
  write_file_atomically(folder / "text.txt", "?");

  const Json arrays = inspect(folder / "a.npz");
  EXPECT_EQ(arrays["kind"], "arrays");
  EXPECT_EQ(arrays["numbers"], 6);
  EXPECT_EQ(arrays["list"][0]["shape"], Json({2, 3}));
  EXPECT_EQ(inspect(folder / "config.json")["models"]["model"], "SkinAutoEncoder");
  const Json dataset = inspect(folder / "data");
  EXPECT_EQ(dataset["rows"], 3);
  EXPECT_EQ(dataset["is_test"], 1);
  EXPECT_EQ(dataset["num_joints"]["median"], 5.0);
  EXPECT_EQ(inspect(folder.path())["kind"], "run");
  EXPECT_THROW(inspect(folder / "text.txt"), InputError);
  EXPECT_THROW(inspect(folder / "absent.glb"), InputError);
  EXPECT_NE(to_text(arrays).find("x"), std::string::npos);
}

TEST(FileTable, ShowsRepairsAndRejections) {
  const Json good = {{"kind", "asset"},
                     {"joints", 4},
                     {"vertices", 8},
                     {"faces", 6},
                     {"influences", {{"1", 3}, {"12", 5}}},
                     {"notes", {{{"code", "nan_weights"}, {"message", "m"}}}}};
  const Table table = file_table({{"a.glb", good, ""}, {"b.glb", {}, "truncated"}});
  ASSERT_EQ(table.rows.size(), 2u);
  EXPECT_EQ(table.rows[0], (std::vector<std::string>{"a.glb", "4", "8", "6", "12", "nan_weights"}));
  EXPECT_EQ(table.rows[1].back(), "rejected: truncated");
}

// The vectors of RFC 4648, section 10.
TEST(Base64, AgreesWithTheRfc) {
  const auto encoded = [](const std::string& text) { return base64({text.begin(), text.end()}); };
  EXPECT_EQ(encoded(""), "");
  EXPECT_EQ(encoded("f"), "Zg==");
  EXPECT_EQ(encoded("fo"), "Zm8=");
  EXPECT_EQ(encoded("foo"), "Zm9v");
  EXPECT_EQ(encoded("foobar"), "Zm9vYmFy");
}

TEST(LineChart, DrawsOnlyWhatIsACurve) {
  EXPECT_EQ(line_chart("t", {}), "");
  EXPECT_EQ(line_chart("t", {{1, 1}, {2, std::nan("")}}), "");
  const std::string svg = line_chart("eval.l1 <x>", {{0, 1}, {10, 0.5}});
  EXPECT_NE(svg.find("<polyline"), std::string::npos);
  EXPECT_NE(svg.find("&lt;x&gt;"), std::string::npos);
}

}  // namespace
}  // namespace anigen::eval
