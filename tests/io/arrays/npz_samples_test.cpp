#include "anigen/io/arrays/npz_samples.h"

#include <gtest/gtest.h>

#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::io {
namespace {

using test::PickleBuilder;
using test::raw;

constexpr const char* kNumbers[] = {"zero", "one", "two"};

class NpzSamplesTest : public testing::Test {
 protected:
  std::filesystem::path file(const std::string& pickle, const std::string& shape = "(3,)") const {
    const std::string header = "{'descr': '|O', 'fortran_order': False, 'shape': " + shape + ", }";
    const std::filesystem::path path = folder_ / "s.npz";
    write_zip(path, {{"allow_pickle.npy", test::npy("{'descr': '|b1', 'fortran_order': False, 'shape': (), }", "\1")},
                     {"arr_0.npy", test::npy(header, pickle)}});
    return path;
  }

  /// An array of 2,000 numbers, longer than what an outline keeps.
  static void add_long_array(PickleBuilder& pickle, double first) {
    std::vector<double> values(2000);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = first + static_cast<double>(i);
    std::string bytes(values.size() * sizeof(double), '\0');
    std::memcpy(bytes.data(), values.data(), bytes.size());
    pickle.begin_array({2000}).dtype("f8").boolean(false).data(bytes).end_array();
  }

  /// Three dictionaries. The second and third take their keys, a type and a text from the first by the memo, as
  /// Python's pickler does with objects that it has met before.
  static std::string pickled(const std::string& between = "") {
    PickleBuilder pickle(4);
    pickle.begin_array({3}).dtype("O8", "|").boolean(false).op("]").op("\x94").mark();
    pickle.op("}").op("\x94").mark().text("uuid").op("\x94").text("zero").op("\x94");
    pickle.text("numbers").op("\x94");
    add_long_array(pickle, 0);
    pickle.text("names").op("\x94").op("]").op("\x94").mark().text("hip").op("\x94").text("knee").op("\x94").op("e");
    pickle.op("u");
    // Memo: 0 list, 1 dict, 2 "uuid", 3 "zero", 4 "numbers", 5 "names", 6 list, 7 "hip", 8 "knee".
    for (const char* name : {"one", "two"}) {
      pickle.op(raw("\x95\x10\0\0\0\0\0\0\0"));  // a frame begins
      pickle.op("}").op("\x94").mark().op(raw("h\2")).text(name).op("\x94").op(raw("h\4"));
      add_long_array(pickle, 100);
      pickle.op(raw("h\5"))
          .op("]")
          .op("\x94")
          .mark()
          .op(raw("h\x08"))
          .text("toe")
          .op("\x94")
          .op("e")
          .op(between)
          .op("u");
    }
    return pickle.op("e").end_array().stop();
  }
  test::TemporaryFolder folder_;
};

TEST_F(NpzSamplesTest, ReadsEachAsTheWholeHasIt) {
  const auto path = file(pickled());
  const auto samples = NpzSamples::open(path, "uuid");
  ASSERT_NE(samples, nullptr);
  ASSERT_EQ(samples->size(), 3u);
  const NpzValue whole = read_npz_objects(path, {"arr_0"}).front().second;
  for (const std::size_t i : {2u, 0u, 1u}) {
    EXPECT_EQ(samples->name(i), kNumbers[i]);
    const NpzValue sample = samples->read(i);
    EXPECT_EQ(sample.keys, whole.items[i].keys);
    EXPECT_EQ(sample.find("uuid")->text, kNumbers[i]);
    EXPECT_EQ(sample.find("numbers")->array.bytes, whole.items[i].find("numbers")->array.bytes);
    ASSERT_EQ(sample.find("names")->items.size(), 2u);
    for (const std::size_t k : {0u, 1u})
      EXPECT_EQ(sample.find("names")->items[k].text, whole.items[i].find("names")->items[k].text);
  }
  EXPECT_EQ(samples->read(1).find("names")->items[0].text, "knee");
}

TEST_F(NpzSamplesTest, SharedListsAndOtherThingsAreForTheWholeReader) {
  // The list of names of the first, again in the others.
  EXPECT_EQ(NpzSamples::open(file(pickled(raw("X\5\0\0\0extrah\6"))), "uuid"), nullptr);
  PickleBuilder numbers(4);
  numbers.begin_array({2}).dtype("O8", "|").boolean(false).op("]").mark().integer(1).integer(2).op("e").end_array();
  EXPECT_EQ(NpzSamples::open(file(numbers.stop(), "(2,)"), "uuid"), nullptr);
  PickleBuilder mixed(4);
  mixed.begin_array({2}).dtype("O8", "|").boolean(false).op("]").mark().op("}").integer(2).op("e").end_array();
  EXPECT_EQ(NpzSamples::open(file(mixed.stop(), "(2,)"), "uuid"), nullptr);
  write_zip(folder_ / "n.npz",
            {{"a.npy", test::npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), }", "abcd")}});
  EXPECT_EQ(NpzSamples::open(folder_ / "n.npz", "uuid"), nullptr);
}

TEST_F(NpzSamplesTest, DamageOfOneArrayIsThatSamplesAlone) {
  std::string pickle = pickled();
  // The first array's declared length in its shape: 2000 becomes 2001.
  const std::size_t at = pickle.find(raw("J\xd0\x07\0\0"));
  ASSERT_NE(at, std::string::npos);
  pickle[at + 1] = '\xd1';
  const auto samples = NpzSamples::open(file(pickle), "uuid");
  ASSERT_NE(samples, nullptr);
  EXPECT_THROW(samples->read(0), InputError);
  EXPECT_EQ(samples->read(1).find("uuid")->text, "one");
}

TEST_F(NpzSamplesTest, RefusesAnotherCountAndDamagedFiles) {
  EXPECT_THROW(NpzSamples::open(file(pickled(), "(4,)"), "uuid"), InputError);
  EXPECT_THROW(NpzSamples::open(file(pickled(), "(4000000000000,)"), "uuid"), InputError);
  std::string hostile = pickled();
  const std::size_t at = hostile.find("X" + test::little(7, 4) + "numbers");
  ASSERT_NE(at, std::string::npos);
  hostile.replace(at, 5, "X" + test::little(0xFFFFFFF0u, 4));
  EXPECT_THROW(NpzSamples::open(file(hostile), "uuid"), InputError);
  EXPECT_THROW(NpzSamples::open(file(pickled().substr(0, 9000)), "uuid"), InputError);
  const auto read_all = [](const std::filesystem::path& path) {
    const auto samples = NpzSamples::open(path, "uuid");
    for (std::size_t i = 0; samples && i < samples->size(); ++i) samples->read(i);
  };
  // Stored, so that damage reaches the pickle: the checksum of a whole pass refuses it.
  const std::string header = "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }";
  const std::string bytes = test::stored_zip({{"arr_0.npy", test::npy(header, pickled())}});
  EXPECT_GT(test::read_damaged(bytes, "d.npz", read_all), 250);
}

}  // namespace
}  // namespace anigen::io
