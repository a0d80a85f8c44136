#include <gtest/gtest.h>

#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "tests/io/arrays/array_file_bytes.h"
#include "tests/support/rig_files.h"

namespace anigen::io {
namespace {

using ListedIds = std::vector<std::string>;

/// A source of names only.
class Names : public ShapeSource {
 public:
  explicit Names(ListedIds ids, std::map<std::string, ListedIds> others = {})
      : ids_(std::move(ids)), others_(std::move(others)) {}
  ListedIds ids() const override { return ids_; }
  RiggedShape read(const std::string&) const override { return {}; }
  std::string describe() const override { return "names"; }
  ListedIds other_names(const std::string& id) const override {
    const auto found = others_.find(id);
    return found == others_.end() ? ListedIds{} : found->second;
  }

 private:
  ListedIds ids_;
  std::map<std::string, ListedIds> others_;
};

TEST(Split, SelectsInTheSourcesOrderAndNamesTheLineOfAnUnknownId) {
  const test::TemporaryFolder folder;
  const Names source({"a", "b", "c"}, {{"c", {"cat", "same"}}, {"b", {"same"}}});
  test::write_quickly(folder / "test.txt", "# the test split\r\n\r\n  cat \r\na\r\n");
  test::write_quickly(folder / "more.txt", "a\nb");
  EXPECT_EQ(select_ids(source, {}), (ListedIds{"a", "b", "c"}));
  EXPECT_EQ(select_ids(source, {folder / "test.txt"}), (ListedIds{"a", "c"}));
  EXPECT_EQ(select_ids(source, {folder / "test.txt", folder / "more.txt"}), (ListedIds{"a", "b", "c"}));
  EXPECT_EQ(select_ids(source, {}, 2), (ListedIds{"a", "b"}));
  EXPECT_EQ(select_ids(source, {folder / "test.txt"}, 1), ListedIds{"c"}) << "the split's first, not the source's";
  EXPECT_EQ(read_split(folder / "test.txt")[0].line, 3u);
  test::write_quickly(folder / "short.txt", "d\n");
  EXPECT_EQ(select_ids(Names({"c/e", "x/d"}), {folder / "short.txt"}), ListedIds{"x/d"});
  const auto problem = [&](const std::string& text) {
    test::write_quickly(folder / "bad.txt", text);
    return test::refusal([&] { select_ids(source, {folder / "bad.txt"}); });
  };
  EXPECT_EQ(problem("a\n\nz\n"), "line 3: there is no \"z\" in names");
  EXPECT_EQ(problem("same\n"), "line 1: \"same\" could be meant for several assets: b, c");
  EXPECT_EQ(problem("# nothing\n"), "the split names no id");
  EXPECT_NE(test::refusal([&] { read_split(folder / "missing.txt"); }), "");
}

TEST(NameForms, AreThoseThatOtherProgramsWrite) {
  EXPECT_EQ(name_forms("uuid.glb"), (NameForms{{"uuid", 1}}));
  EXPECT_EQ(name_forms("./glbs/fish/manta.FBX"), (NameForms{{"glbs/fish/manta", 3}, {"fish/manta", 2}, {"manta", 1}}));
  EXPECT_EQ(name_forms("in/shard.npz#u-1"), (NameForms{{"in/shard.npz#u-1", 3}, {"shard.npz#u-1", 2}, {"u-1", 1}}));
  EXPECT_EQ(name_forms("g.pt#a/b"), (NameForms{{"g.pt#a/b", 3}, {"a/b", 2}, {"b", 1}}));
  EXPECT_EQ(name_forms("cat#2"), (NameForms{{"cat#2", 2}})) << "no shard";
  EXPECT_EQ(name_forms("out/uuid/mesh.glb"), (NameForms{{"out/uuid", 2}, {"uuid", 1}}));
  EXPECT_EQ(name_forms("raw_data.npz"), (NameForms{{"raw_data", 1}})) << "has no other name";
  EXPECT_EQ(name_forms("v1.2"), (NameForms{{"v1.2", 1}})) << "what follows a point is not always an extension";
  EXPECT_TRUE(name_forms("").empty());
  EXPECT_TRUE(name_forms("../other/uuid.glb").empty());
}

TEST(NameIndex, TheLongestSharedFormDecidesAndTwoAreAmbiguous) {
  NameIndex index;
  index.add("1", std::vector<std::string>{"fish/manta.glb"});
  index.add("2", std::vector<std::string>{"cat/manta.glb"});
  EXPECT_EQ(index.find(name_forms("x/fish/manta")), std::set<std::string>{"1"});
  EXPECT_EQ(index.find(name_forms("manta.npz")), (std::set<std::string>{"1", "2"}));
  EXPECT_TRUE(index.find(name_forms("shark")).empty());
  EXPECT_EQ(index.find_one("2", "f", ""), "2");
  EXPECT_EQ(test::refusal([&] { index.find_one("manta", "f", "line 1"); }),
            "line 1: \"manta\" could be meant for several assets: 1, 2");
}

TEST(Split, NamesSamplesAndFilesByTheirContentToo) {
  const test::TemporaryFolder folder;
  test::RigFile first, second;
  first.uuid = "first";
  second.uuid = "second";
  second.joints[4] = 7;
  test::write_articulation_xl(folder / "xl.npz", {first, second});
  const auto shard = open_source(folder / "xl.npz", {Axes::kFormat, true});
  test::write_quickly(folder / "split.txt", shard->sample_id("second") + "\n");
  EXPECT_EQ(select_ids(*shard, {folder / "split.txt"}), ListedIds{"second"});
  EXPECT_NE(test::refusal([&] { select_ids(*open_source(folder / "xl.npz"), {folder / "split.txt"}); }), "");

  test::write_glb(folder / "glbs" / "a.glb", first);
  test::write_glb(folder / "glbs" / "b.glb", second);
  const auto files = open_source(folder / "glbs");
  EXPECT_EQ(files->sample_id("b"), sha256(read_file(folder / "glbs" / "b.glb")));
  test::write_quickly(folder / "split.txt", files->sample_id("b") + "\n");
  EXPECT_EQ(select_ids(*files, {folder / "split.txt"}), ListedIds{"b"});
}

}  // namespace
}  // namespace anigen::io
