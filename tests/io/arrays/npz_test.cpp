#include "anigen/io/arrays/npz.h"

#include <gtest/gtest.h>

#include <cmath>

#include "anigen/io/arrays/npy.h"
#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::io {
namespace {

using test::little;
using test::npy;
using test::PickleBuilder;
using test::raw;

class Npz : public ::testing::Test {
 protected:
  std::filesystem::path archive(const std::vector<ZipContent>& members) {
    write_zip(folder_ / "x.npz", members);
    return folder_ / "x.npz";
  }
  NamedArrays read_one(const std::string& npy_bytes) { return read_npz(archive({{"a.npy", npy_bytes}})); }
  std::string problem(const std::string& npy_bytes) {
    try {
      read_one(npy_bytes);
    } catch (const InputError& error) {
      EXPECT_NE(std::string(error.what()).find("a.npy"), std::string::npos) << error.what();
      return error.what();
    }
    return "accepted";
  }
  static std::string header(const std::string& descr, const std::string& shape, const std::string& order = "False") {
    return "{'descr': '" + descr + "', 'fortran_order': " + order + ", 'shape': " + shape + ", }";
  }
  test::TemporaryFolder folder_;
};

TEST_F(Npz, RoundTripsEveryNumericDtype) {
  NamedArrays arrays;
  for (int d = 0; d <= static_cast<int>(Dtype::kF64); ++d) {
    const auto dtype = static_cast<Dtype>(d);
    if (dtype == Dtype::kBF16) continue;
    NdArray array{dtype, {2, 2}, {}};
    for (std::size_t i = 0; i < 4 * size_of(dtype); ++i)
      array.bytes.push_back(dtype == Dtype::kBool ? i % 2 : i * 7 % 256);
    arrays.emplace_back(name_of(dtype), array);
  }
  arrays.emplace_back("scalar", NdArray::from<double>({std::nan("")}, {}));
  arrays.emplace_back("empty", NdArray::from<float>({}, {0, 3}));
  write_npz(folder_ / "a.npz", arrays);
  const NamedArrays back = read_npz(folder_ / "a.npz");
  const NamedArrays headers = read_npz_headers(folder_ / "a.npz");
  ASSERT_EQ(back.size(), arrays.size());
  for (std::size_t i = 0; i < arrays.size(); ++i) {
    EXPECT_EQ(back[i].first, arrays[i].first);
    EXPECT_EQ(back[i].second.dtype, arrays[i].second.dtype);
    EXPECT_EQ(back[i].second.shape, arrays[i].second.shape);
    EXPECT_EQ(back[i].second.bytes, arrays[i].second.bytes);
    EXPECT_EQ(headers[i].second.shape, arrays[i].second.shape);
    EXPECT_TRUE(headers[i].second.bytes.empty());
  }
  write_npz(folder_ / "b.npz", arrays);
  EXPECT_EQ(read_file(folder_ / "a.npz"), read_file(folder_ / "b.npz"));
  EXPECT_THROW(write_npz(folder_ / "c.npz", {{"x", NdArray{Dtype::kBF16, {1}, {0, 0}}}}), Error);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "c.npz"));
  write_npz(folder_ / "none.npz", {});
  EXPECT_TRUE(read_npz(folder_ / "none.npz").empty());
}

TEST_F(Npz, StoredMembers) {
  const NdArray array = NdArray::from<float>({1, 2}, {2});
  test::write_quickly(folder_ / "a.npz",
                      test::stored_zip({{"x.npy", encode_npy(array, "x")}, {"notes.txt", "no array"}}));
  const NamedArrays arrays = read_npz(folder_ / "a.npz");
  ASSERT_EQ(arrays.size(), 1u);
  EXPECT_EQ(arrays[0].second.bytes, array.bytes);
}

TEST_F(Npz, SelectsMembers) {
  write_npz(folder_ / "a.npz", {{"x", NdArray::from<float>({1}, {1})}, {"y", NdArray::from<float>({2}, {1})}});
  const NamedArrays some = read_npz(folder_ / "a.npz", {"y"});
  ASSERT_EQ(some.size(), 1u);
  EXPECT_EQ(some[0].second.as<float>()[0], 2.0f);
  try {
    read_npz(folder_ / "a.npz", {"z"});
    FAIL() << "a missing array was accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("'z'; it holds: x, y"), std::string::npos) << error.what();
  }
}

TEST_F(Npz, OrdersVersionsAndHeadersOfOtherWriters) {
  const auto numbers = [&](const std::string& bytes) { return read_one(bytes)[0].second.as<std::int64_t>(); };
  const std::string six = raw("\1\0\2\0\3\0\4\0\5\0\6\0");
  EXPECT_EQ(numbers(npy(header("<i2", "(2, 3)"), six)), (std::vector<std::int64_t>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(numbers(npy(header("<i2", "(2, 3)", "True"), six)), (std::vector<std::int64_t>{1, 3, 5, 2, 4, 6}));
  EXPECT_EQ(numbers(npy(header(">i2", "(6,)"), raw("\0\1\0\2\0\3\0\4\0\5\0\6"))),
            (std::vector<std::int64_t>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(numbers(npy(" { \"shape\" :(6L , ),\"fortran_order\":False , \"descr\":'<i2'}   ", six)).size(), 6u);
  const std::string text = header("<i2", "(6,)");
  EXPECT_EQ(numbers(raw("\x93NUMPY\2\0") + little(text.size(), 4) + text + six).size(), 6u);
  EXPECT_EQ(numbers(raw("\x93NUMPY\3\0") + little(text.size(), 4) + text + six).size(), 6u);
  EXPECT_EQ(numbers(npy(header("|i1", "()"), "\x05")), std::vector<std::int64_t>{5});
  EXPECT_TRUE(numbers(npy(header("<i8", "(0, 9223372036854775800)"), "")).empty());
}

TEST_F(Npz, RefusesHostileHeaders) {
  EXPECT_NE(problem(npy(header("<f4", "(-1,)"), "")).find("negative"), std::string::npos);
  EXPECT_NE(problem(npy(header("<f4", "(99999999999999999999,)"), "")).find("overflows"), std::string::npos);
  EXPECT_NE(problem(npy(header("<f4", "(4294967296, 4294967296)"), "")).find("overflows"), std::string::npos);
  EXPECT_NE(problem(npy(header("<f4", "(1000000000000,)"), "1234")).find("4000000000000 bytes"), std::string::npos);
  EXPECT_NE(problem(npy(header("<f4", "(1,)"), "12345678")).find("8 are there"), std::string::npos);
  EXPECT_NE(problem(npy(header("<c8", "(1,)"), "12345678")).find("not supported: numpy dtype '<c8'"),
            std::string::npos);
  EXPECT_NE(problem(npy(header("<M8[ns]", "(1,)"), "12345678")).find("not supported"), std::string::npos);
  EXPECT_NE(
      problem(npy("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,), }", "1234")).find("structured"),
      std::string::npos);
  EXPECT_NE(problem("hello world").find("not an NPY array"), std::string::npos);
  EXPECT_NE(problem("").find("ends inside"), std::string::npos);
  EXPECT_NE(problem(raw("\x93NUMPY\1\0\xff\xff{")).find("ends inside"), std::string::npos);
  EXPECT_NE(problem(raw("\x93NUMPY\2\0\xff\xff\xff\xff{")).find("implausible"), std::string::npos);
  EXPECT_NE(problem(raw("\x93NUMPY\7\0\1\0{")).find("NPY version 7"), std::string::npos);
  for (const char* damaged : {"", "{", "{}", "{'descr'}", "{'descr': '<f4', 'shape': (1,)}", "[1]", "{'descr': '<f4}",
                              "{'descr': '<f4', 'fortran_order': 1, 'shape': (1,)}",
                              "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'os': 1}",
                              "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)} + 1",
                              "{'descr': '<f4', 'fortran_order': False, 'shape': (1 1)}"}) {
    EXPECT_NE(problem(npy(damaged, "1234")), "accepted") << damaged;
  }
}

TEST_F(Npz, ObjectArraysOfIntegersAndNone) {
  // As numpy.save writes numpy.array([None, 0, 0, 1], dtype=object), protocol 3.
  PickleBuilder parents(3);
  parents.begin_array({4}).dtype("O8", "|").boolean(false);
  parents.op("]").mark().none().integer(0).integer(0).integer(1).op("e").end_array();
  const NamedArrays arrays = read_one(npy(header("|O", "(4,)"), parents.stop()));
  ASSERT_EQ(arrays.size(), 1u);
  EXPECT_EQ(arrays[0].first, "a");
  EXPECT_EQ(arrays[0].second.dtype, Dtype::kI64);
  EXPECT_EQ(arrays[0].second.as<std::int64_t>(), (std::vector<std::int64_t>{-1, 0, 0, 1}));

  PickleBuilder mixed;
  mixed.begin_array({2})
      .dtype("O8", "|")
      .boolean(false)
      .op("]")
      .mark()
      .integer(1)
      .real(std::nan(""))
      .op("e")
      .end_array();
  const NdArray reals = read_one(npy(header("|O", "(2,)"), mixed.stop()))[0].second;
  EXPECT_EQ(reals.dtype, Dtype::kF64);
  EXPECT_TRUE(std::isnan(reals.as<double>()[1]));

  PickleBuilder strings;
  strings.begin_array({1}).dtype("O8", "|").boolean(false).op("]").mark().text("hip").op("e").end_array();
  EXPECT_NE(problem(npy(header("|O", "(1,)"), strings.stop())).find("not supported: text"), std::string::npos);
  PickleBuilder half_missing;
  half_missing.begin_array({2}).dtype("O8", "|").boolean(false).op("]").mark().none().real(1.5).op("e").end_array();
  EXPECT_NE(problem(npy(header("|O", "(2,)"), half_missing.stop())).find("not supported"), std::string::npos);
  EXPECT_NE(problem(npy(header("|O", "(5,)"), parents.stop())).find("header announces"), std::string::npos);
  EXPECT_NE(problem(npy(header("|O", "(1,)"), "cos\nsystem\n.")).find("os.system"), std::string::npos);
  EXPECT_NE(problem(npy(header("|O", "(1,)"), "cos\nsystem\n.")).find("byte "), std::string::npos);
}

/// One sample of the layout of Articulation-XL 2.0 in an object array of dicts.
std::string rig_samples(int count) {
  PickleBuilder pickle(3);
  pickle.begin_array({count}).dtype("O8", "|").boolean(false).op("]").mark();
  for (int i = 0; i < count; ++i) {
    pickle.op("}").mark();
    pickle.text("vertices").begin_array({1, 3}).dtype("f8").boolean(false);
    pickle.data(little(0x3FF0000000000000, 8) + little(0, 8) + little(0x4000000000000000, 8)).end_array();
    pickle.text("pc_w_norm").begin_array({2}).dtype("f2").boolean(false).data(raw("\0\x3c\0\xc0")).end_array();
    pickle.text("uuid").text("id-" + std::to_string(i)).text("root_index").integer(i);
    pickle.text("joint_names").op("]").mark().text("hip").text("knee").op("e");
    pickle.text("skinning_weights_shape").mark().integer(1).integer(2).tuple();
    pickle.op("u");
  }
  return pickle.op("e").end_array().stop();
}

TEST_F(Npz, DictsInsideObjectArrays) {
  const std::string bytes = npy(header("|O", "(2,)"), rig_samples(2));
  const auto path = archive({{"arr_0.npy", bytes}, {"allow_pickle.npy", npy(header("|b1", "()"), "\1")}});
  const NamedArrays arrays = read_npz(path);
  const NdArray* vertices = find(arrays, "arr_0.1.vertices");
  ASSERT_NE(vertices, nullptr);
  EXPECT_EQ(vertices->shape, (std::vector<std::int64_t>{1, 3}));
  EXPECT_EQ(vertices->as<double>(), (std::vector<double>{1, 0, 2}));
  EXPECT_EQ(find(arrays, "arr_0.0.pc_w_norm")->dtype, Dtype::kF16);
  EXPECT_EQ(find(arrays, "arr_0.1.root_index")->as<std::int64_t>(), std::vector<std::int64_t>{1});
  EXPECT_EQ(find(arrays, "arr_0.0.skinning_weights_shape")->as<std::int64_t>(), (std::vector<std::int64_t>{1, 2}));
  EXPECT_EQ(find(arrays, "arr_0.0.uuid"), nullptr);
  EXPECT_NE(find(arrays, "allow_pickle"), nullptr);

  const auto objects = read_npz_objects(path, {"arr_0"});
  ASSERT_EQ(objects.size(), 1u);
  const NpzValue& samples = objects[0].second;
  ASSERT_EQ(samples.items.size(), 2u);
  EXPECT_EQ(samples.items[1].find("uuid")->text, "id-1");
  EXPECT_EQ(samples.items[0].find("joint_names")->items[1].text, "knee");
  EXPECT_EQ(samples.items[0].find("vertices")->array.as<double>()[2], 2.0);
  EXPECT_EQ(samples.items[0].find("nothing"), nullptr);
}

TEST_F(Npz, TextArraysAsObjects) {
  const std::string text = raw("h\0\0\0i\0\0\0\xe9\0\0\0\0\0\0\0");
  const auto path =
      archive({{"names.npy", npy(header("<U2", "(2,)"), text)}, {"raw.npy", npy(header("|S3", "(1,)"), raw("ab\0"))}});
  const auto objects = read_npz_objects(path);
  EXPECT_EQ(objects[0].second.items[0].text, "hi");
  EXPECT_EQ(objects[0].second.items[1].text, "é");
  EXPECT_EQ(objects[1].second.items[0].text, "ab");
  EXPECT_THROW(read_npz(path), NotSupportedError);
  EXPECT_TRUE(read_npz_headers(path).empty());
}

TEST_F(Npz, SelfContainingObjectsEnd) {
  PickleBuilder cycle;
  cycle.begin_array({1}).dtype("O8", "|").boolean(false).op("]").op("q\x09").mark().op("h\x09").op("e").end_array();
  EXPECT_NE(problem(npy(header("|O", "(1,)"), cycle.stop())).find("contain themselves"), std::string::npos);
  PickleBuilder laughs;  // each list holds the one before it twice: 2^28 leaves from 300 bytes
  laughs.op(
      "]q\x01"
      "0");
  for (char i = 1; i < 29; ++i) {
    laughs.op(std::string("]q") + static_cast<char>(i + 1)).mark();
    laughs.op(std::string("h") + i + "h" + i + "e0");
  }
  laughs.begin_array({1})
      .dtype("O8", "|")
      .boolean(false)
      .op("]")
      .mark()
      .op("h\x1d"
          "e")
      .end_array();
  EXPECT_NE(problem(npy(header("|O", "(1,)"), laughs.stop())).find("expand to far more"), std::string::npos);
}

TEST_F(Npz, RefusesZipBombsAndDamage) {
  const auto path = archive({{"a.npy", npy(header("|u1", "(100000,)"), std::string(100000, '\0'))}});
  ZipLimits strict;
  strict.ratio_applies_above = 1000;
  strict.max_ratio = 50;
  EXPECT_THROW(ZipReader(path, strict), InputError);
  EXPECT_NO_THROW(ZipReader{path});

  const std::string good = read_file(path);
  const auto patched = [&](std::size_t field, const std::string& value) {
    std::string bytes = good;
    bytes.replace(bytes.rfind("PK\x01\x02") + field, value.size(), value);
    write_file_atomically(folder_ / "y.npz", bytes);
    try {
      read_npz(folder_ / "y.npz");
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  constexpr std::size_t kMethod = 10, kCrc = 16, kSize = 24;
  EXPECT_NE(patched(kSize, little(0x7FFFFFFF, 4)).find("decompression bomb"), std::string::npos);
  EXPECT_NE(patched(kCrc, "\x12\x34"), "accepted");
  EXPECT_NE(patched(kSize, little(50, 4)), "accepted");
  EXPECT_NE(patched(kMethod, little(12, 2)), "accepted");
  write_file_atomically(folder_ / "y.npz", "not a zip");
  EXPECT_THROW(read_npz(folder_ / "y.npz"), InputError);
  EXPECT_THROW(read_npz(folder_ / "missing.npz"), InputError);
}

TEST_F(Npz, RefusesMembersThatShareTheirBytes) {
  std::string noise;
  Rng rng(1, "noise");
  for (int i = 0; i < 3000; ++i) noise += static_cast<char>(rng.index(256));
  const std::string good = read_file(archive({{"a.npy", noise}}));
  const std::size_t directory = good.rfind("PK\x01\x02"), end = good.rfind("PK\x05\x06");
  const std::string entry = good.substr(directory, end - directory);
  std::string bytes = good.substr(0, directory);
  for (const char* name : {"a.npy", "b.npy", "c.npy"}) {
    std::string copy = entry;
    bytes += copy.replace(46, 5, name);
  }
  std::string tail = good.substr(end);
  tail.replace(8, 8, little(3, 2) + little(3, 2) + little(3 * entry.size(), 4));
  write_file_atomically(folder_ / "y.npz", bytes + tail);
  try {
    ZipReader reader(folder_ / "y.npz");
    FAIL() << "overlapping members were accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("larger than the file"), std::string::npos) << error.what();
  }
}

TEST_F(Npz, DamagedFilesOnlyThrow) {
  const auto path = archive({{"arr_0.npy", npy(header("|O", "(1,)"), rig_samples(1))},
                             {"x.npy", encode_npy(NdArray::from<float>({1, 2, 3}, {3}), "x")}});
  const auto read = [](const auto& file) {
    read_npz(file);
    read_npz_objects(file);
  };
  EXPECT_GT(test::read_damaged(read_file(path), "x.npz", read), 100);
  // Past the checksum: damage inside the members themselves.
  const std::string member = npy(header("|O", "(1,)"), rig_samples(1));
  const auto read_member = [&](const std::filesystem::path& file) {
    test::write_quickly(folder_ / "inner.npz", test::stored_zip({{"arr_0.npy", read_file(file)}}));
    read(folder_ / "inner.npz");
  };
  EXPECT_GT(test::read_damaged(member, "member.npy", read_member), 100);
}

}  // namespace
}  // namespace anigen::io
