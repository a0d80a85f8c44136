#include "anigen/eval/inspect.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/eval/describe.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/obj.h"
#include "anigen/io/ply.h"
#include "tests/support/paths.h"
#include "tests/support/picture_files.h"
#include "tests/support/rig_files.h"
#include "tests/support/scene_files.h"

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

/// Every format of a rig, a mesh or a motion, from one rig of three joints and two quads.
class InspectGeometry : public ::testing::Test {
 protected:
  Json described(const std::string& name) const { return inspect(folder_ / name); }
  void write(const std::string& name, const std::string& text) const { write_file_atomically(folder_ / name, text); }

  test::TemporaryFolder folder_;
  const test::RigFile rig_;
};

void expect_rig(const Json& json, const std::string& format, const std::string& axes) {
  EXPECT_EQ(json["kind"], "asset") << json.dump();
  EXPECT_EQ(json["rig"], "skinned");
  EXPECT_EQ(json["format"], format);
  EXPECT_EQ(json["axes"].get<std::string>().rfind(axes, 0), 0u) << json["axes"];
  EXPECT_EQ(json["joints"], 3) << format;
  EXPECT_EQ(json["roots"], 1);
  EXPECT_EQ(json["skeleton_depth"], 3);
  EXPECT_EQ(json["vertices"], 6) << format;
  EXPECT_EQ(json["faces"], 4);
  EXPECT_EQ(json["parts"], 1);
  EXPECT_TRUE(json["findings"].empty()) << json["findings"];
  EXPECT_FALSE(to_text(json).empty());
}

TEST_F(InspectGeometry, ReadsRigsOfEveryFormat) {
  test::write_glb(folder_ / "a.glb", rig_);
  write("a.FBX", test::fbx_text(rig_));
  write("a.dae", test::collada_text(rig_));
  test::write_text_rig(folder_ / "a.txt", rig_);
  test::write_rig_npz(folder_ / "a.npz", rig_);
  expect_rig(described("a.glb"), "glTF", "Y up");
  expect_rig(described("a.FBX"), "FBX", "Z up");
  expect_rig(described("a.dae"), "COLLADA", "Z up");
  expect_rig(described("a.txt"), "text rig", "Y up");
  expect_rig(described("a.npz"), "arrays of a rig", "Z up");
  EXPECT_EQ(described("a.dae")["unit"], "1 m");
  EXPECT_EQ(described("a.dae")["animations"][0]["seconds"], 1.0);
  EXPECT_EQ(described("a.npz")["unit"], "not said");
}

TEST_F(InspectGeometry, ReadsShardsAndTheirSamples) {
  test::RigFile other = rig_;
  other.uuid = "other#2";  // names may hold the sign that parts them from the file
  test::write_articulation_xl(folder_ / "xl.npz", {rig_, other});
  const Json shard = described("xl.npz");
  EXPECT_EQ(shard["kind"], "shard");
  EXPECT_EQ(shard["samples"], 2);
  EXPECT_EQ(shard["damaged"], 0);
  EXPECT_EQ(shard["joints_of_samples"]["max"], 3);
  EXPECT_EQ(shard["vertices_of_samples"]["min"], 6);
  EXPECT_EQ(described("xl.npz#sample")["kind"], "asset");
  EXPECT_EQ(described("xl.npz#other#2")["joints"], 3);
  EXPECT_THROW(described("xl.npz#nobody"), InputError);

  test::write_anymate(folder_ / "anymate.pt", {test::per_bone(rig_)});
  EXPECT_EQ(described("anymate.pt")["kind"], "shard");
  EXPECT_EQ(described("anymate.pt")["samples"], 1);
}

TEST_F(InspectGeometry, AMeshWithoutARigIsNoError) {
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {5, 0, 0}, {6, 0, 0}, {5, 1, 0}};
  mesh.faces = {{0, 1, 2}, {3, 4, 5}};
  io::write_obj(folder_ / "a.obj", mesh);
  io::write_ply(folder_ / "a.ply", mesh);
  write("a.stl",
        "solid\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 2 0\nendloop\nendfacet\n"
        "endsolid\n");
  Asset bare;
  bare.name = "bare";
  bare.mesh = mesh;
  io::ExportOptions without_rig;
  without_rig.require_rig = false;
  io::write_gltf(folder_ / "a.glb", bare, without_rig);
  for (const char* name : {"a.obj", "a.ply", "a.stl", "a.glb"}) {
    const Json json = described(name);
    EXPECT_EQ(json["kind"], "mesh") << name;
    EXPECT_EQ(json["rig"], "none: a mesh, no rig");
    EXPECT_EQ(json["joints"], 0);
    EXPECT_EQ(json["parts"], json["faces"]) << name << ": the two triangles share no vertex";
    EXPECT_FALSE(json.contains("influences"));
    EXPECT_TRUE(json["findings"].empty()) << json["findings"];
  }
  EXPECT_EQ(described("a.obj")["box"]["high"], Json({6.0, 0.0, 2.0})) << "OBJ is Y up";
  EXPECT_EQ(described("a.ply")["box"]["high"], Json({6.0, 2.0, 0.0})) << "PLY is Z up";
  mesh.faces.clear();
  io::write_ply(folder_ / "points.ply", mesh);
  EXPECT_EQ(described("points.ply")["kind"], "points");
  write("broken.obj", "v 1 2 x\n");
  try {
    described("broken.obj");
    FAIL() << "was read";
  } catch (const InputError& error) {
    EXPECT_EQ(error.file(), (folder_ / "broken.obj").string());
    EXPECT_EQ(error.place(), "line 1");
  }
}

const char* const kWalkBvh =
    "HIERARCHY\nROOT hips\n{\n OFFSET 0 1 0\n CHANNELS 3 Xposition Yposition Zposition\n JOINT knee\n {\n"
    "  OFFSET 0 1 0\n  CHANNELS 1 Xrotation\n  End Site\n  {\n   OFFSET 0 1 0\n  }\n }\n}\nMOTION\nFrames: 3\n"
    "Frame Time: 0.5\n0 0 0 0\n0 1 0 45\n0 2 0 90\n";

TEST_F(InspectGeometry, AMotionHasASkeletonAndNoMesh) {
  write("walk.bvh", kWalkBvh);
  const Json json = described("walk.bvh");
  EXPECT_EQ(json["kind"], "motion");
  EXPECT_EQ(json["format"], "BVH");
  EXPECT_EQ(json["joints"], 3);
  EXPECT_EQ(json["vertices"], 0);
  EXPECT_EQ(json["frames"], 3);
  EXPECT_EQ(json["frames_per_second"], 2.0);
  EXPECT_EQ(json["animations"][0]["seconds"], 1.0);
  EXPECT_TRUE(json["findings"].empty()) << json["findings"];
}

TEST_F(InspectGeometry, DrawsAndExportsWhatThereIs) {
  write("walk.bvh", kWalkBvh);
  write("a.obj", test::obj_text(rig_));
  io::ExportOptions without_rig;
  without_rig.require_rig = false;
  const auto differs = [](const io::Image& image) {  // from one colour
    return std::any_of(image.rgba.begin() + 4, image.rgba.end(),
                       [&image, i = std::size_t{0}](std::uint8_t byte) mutable { return byte != image.rgba[i++ % 4]; });
  };
  for (const auto& [name, kind, back] :
       {std::tuple{"walk.bvh", FileKind::kMotion, "motion"}, std::tuple{"a.obj", FileKind::kMesh, "mesh"}}) {
    const Asset asset = read_geometry(folder_ / name, kind).imported.asset;
    const io::Image picture = asset_picture(asset, 64);
    EXPECT_GT(picture.width, 2 * 64) << name << ": two pictures";
    EXPECT_LT(picture.width, 3 * 64) << name;
    EXPECT_TRUE(differs(picture)) << name;
    io::write_gltf(folder_ / "out.glb", asset, without_rig);
    EXPECT_EQ(described("out.glb")["kind"], back);
    EXPECT_EQ(described("out.glb")["faces"], asset.mesh.faces.size());
  }
  Asset points;
  points.mesh.vertices = {{0, 0, 0}};
  EXPECT_THROW(asset_picture(points, 64), InputError);
}

TEST_F(InspectGeometry, TablesSayTheKindWhereItDiffers) {
  write("walk.bvh", kWalkBvh);
  test::write_glb(folder_ / "a.glb", rig_);
  io::write_png(folder_ / "p.png", io::Image(4, 2));
  std::vector<InspectedFile> files;
  for (const char* name : {"walk.bvh", "a.glb", "p.png"}) files.push_back({name, described(name), ""});
  const anigen::Table table = file_table(files);
  EXPECT_EQ(table.columns[1], "kind");
  EXPECT_EQ(table.rows[0], (std::vector<std::string>{"walk.bvh", "motion", "3", "0", "0", "", ""}));
  EXPECT_EQ(table.rows[1][1], "asset");
  EXPECT_EQ(table.rows[2],
            (std::vector<std::string>{"p.png", "picture", "", "", "", "", "PNG, 4 x 2, 4 channels of 8 bits"}));
  files.push_back({"b.obj", {}, "truncated"});
  EXPECT_EQ(file_table(files).rows[3], (std::vector<std::string>{"b.obj", "", "", "", "", "", "rejected: truncated"}));
  EXPECT_EQ(file_table({files[1]}).columns[1], "joints");
}

TEST(InspectPictures, SayHowTheyAreStored) {
  const test::TemporaryFolder folder;
  const auto write = [&](const std::string& name, const std::vector<std::uint8_t>& bytes) {
    write_file_atomically(folder / name, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    return inspect(folder / name);
  };
  io::Image image(4, 2, 0xFF0000FFu);
  image.pixel(1, 1)[3] = 0;
  const Json png = write("a.png", io::encode_png(image));
  EXPECT_EQ(png["kind"], "picture");
  EXPECT_EQ(png["format"], "PNG");
  EXPECT_EQ(png["width"], 4);
  EXPECT_EQ(png["height"], 2);
  EXPECT_EQ(png["channels"], 4);
  EXPECT_EQ(png["alpha"]["clear"], 0.125);
  EXPECT_EQ(png["orientation"], 1);
  const Json turned = write("b.JPG", test::jpeg_with_exif(io::encode_jpeg(image, 90), test::exif_block(6)));
  EXPECT_EQ(turned["format"], "JPEG");
  EXPECT_EQ(turned["channels"], 3);
  EXPECT_EQ(turned["orientation"], 6);
  EXPECT_EQ(turned["upright"], (Json{{"width", 2}, {"height", 4}}));
  const Json grey = write("c.tif", test::grey_tiff(3, 2, {1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(grey["format"], "TIFF");
  EXPECT_EQ(grey["channels"], 1);
  EXPECT_EQ(grey["bits"], 8);
  EXPECT_THROW(write("d.png", {1, 2, 3}), InputError);
}

TEST(InspectFolders, CountWhatCanBeRead) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "x" / "a.glb", "?");
  write_file_atomically(folder / "x" / "deep" / "b.GLB", "?");
  write_file_atomically(folder / "x" / "c.png", "?");
  write_file_atomically(folder / "y" / "notes.md", "?");
  const Json json = inspect(folder / "x");
  EXPECT_EQ(json["kind"], "folder");
  EXPECT_EQ(json["files"], (Json{{".glb", 2}, {".png", 1}}));
  EXPECT_THROW(inspect(folder / "y"), InputError);
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

TEST(Text, HoldsNamesThatAreNotUtf8) {
  const Json json = {{"box", {{"low", Json::array({"a\xFF"})}}}, {"name", "b\xFF"}};
  EXPECT_EQ(to_text(json), "box: low [\"a\xEF\xBF\xBD\"]\nname: b\xFF\n");
}

TEST(FileTable, ShowsRepairsAndRejections) {
  const Json good = {{"kind", "asset"},
                     {"joints", 4},
                     {"vertices", 8},
                     {"faces", 6},
                     {"influences", {{"1", 3}, {"12", 5}}},
                     {"notes", {{{"code", "nan_weights"}, {"message", "m"}}}}};
  const anigen::Table table = file_table({{"a.glb", good, ""}, {"b.glb", {}, "truncated"}});
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

}  // namespace
}  // namespace anigen::eval
