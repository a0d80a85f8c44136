#include "anigen/io/arrays/pickle.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::io::pickle {
namespace {

using test::little;
using test::PickleBuilder;
using test::raw;

Document run(const std::string& bytes, bool torch = false) { return load(bytes, {"file", "member", 100, torch}); }

std::string problem(const std::string& bytes) {
  try {
    run(bytes);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(Pickle, PlainValuesOfAllProtocols) {
  // Result of Python's pickle.dumps({'a': [1, -2, 300, 70000, 2**40], 'b': (True, None, 1.5), 'c': {'é'}, 'd':
  // b'\\x00\\xff'}, n) gives.
  const std::string protocol4 =
      raw("\x80\x04\x95\x51\0\0\0\0\0\0\0}\x94(\x8c\x01"
          "a\x94]\x94(K\x01J\xfe\xff\xff\xffM,\x01Jp\x11\x01\0\x8a\x06\0\0\0\0\0\x01"
          "e\x8c\x01"
          "b\x94\x88NG?\xf8\0\0\0\0\0\0\x87\x94\x8c\x01"
          "c\x94\x8f\x94(\x8c\x02\xc3\xa9\x94\x90\x8c\x01"
          "d\x94"
          "C\x02\0\xff\x94u.");
  const Document document = run(protocol4);
  const Value& dict = document.root();
  ASSERT_EQ(dict.kind, Kind::kDict);
  ASSERT_EQ(dict.items.size(), 8u);
  const Value& list = *dict.items[1];
  const std::vector<std::int64_t> expected = {1, -2, 300, 70000, std::int64_t{1} << 40};
  ASSERT_EQ(list.items.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_EQ(list.items[i]->integer, expected[i]);
  const Value& tuple = *dict.items[3];
  EXPECT_EQ(tuple.kind, Kind::kTuple);
  EXPECT_EQ(tuple.items[0]->kind, Kind::kBool);
  EXPECT_EQ(tuple.items[1]->kind, Kind::kNone);
  EXPECT_EQ(tuple.items[2]->real, 1.5);
  EXPECT_EQ(dict.items[5]->kind, Kind::kSet);
  EXPECT_EQ(dict.items[5]->items[0]->text, "é");
  EXPECT_EQ(dict.items[7]->text, raw("\0\xff"));

  // pickle.dumps([1, -2, True, None, 1.5, 'é', {'k': (2,)}], 0)
  const Document text = run("(lp0\nI1\naI-2\naI01\naNaF1.5\naV\\u00e9\np1\na(dp2\nVk\np3\n(I2\ntp4\nsa.");
  const Value& items = text.root();
  ASSERT_EQ(items.items.size(), 7u);
  EXPECT_EQ(items.items[1]->integer, -2);
  EXPECT_EQ(items.items[2]->kind, Kind::kBool);
  EXPECT_EQ(items.items[4]->real, 1.5);
  EXPECT_EQ(items.items[5]->text, "é");
  EXPECT_EQ(items.items[6]->items[1]->items[0]->integer, 2);
  EXPECT_EQ(run("S'a\\x41\\n\\101\\\\'\n.").root().text, "aA\nA\\");  // Python 2 str
}

TEST(Pickle, CyclesAreValuesLikeOthers) {
  const Document document =
      run("]q\x01h\x01"
          "a.");  // a list that contains itself
  EXPECT_EQ(document.root().items[0], &document.root());
}

TEST(Pickle, LongIntegers) {
  EXPECT_EQ(run(raw("\x80\x02\x8a\x00.")).root().integer, 0);
  EXPECT_EQ(run(raw("\x80\x02\x8a\x01\xff.")).root().integer, -1);
  EXPECT_EQ(run(raw("\x80\x02\x8a\x08\0\0\0\0\0\0\0\x80.")).root().integer, std::numeric_limits<std::int64_t>::min());
  EXPECT_EQ(run(raw("\x80\x02\x8a\x09\0\0\0\0\0\0\0\0\x01.")).root().kind, Kind::kOpaque);
  EXPECT_EQ(run("L123L\n.").root().integer, 123);
}

TEST(Pickle, NumpyArraysScalarsAndByteOrders) {
  PickleBuilder array;
  array.begin_array({2, 2}).dtype("i2", ">").boolean(true).data(raw("\0\1\0\2\0\3\0\4")).end_array();
  const Document document = run(array.stop());
  ASSERT_TRUE(document.root().array);
  EXPECT_EQ(document.root().array->as<std::int32_t>(), (std::vector<std::int32_t>{1, 3, 2, 4}));  // Fortran order

  PickleBuilder encoded;  // Python 3 at protocol 2: bytes as Latin-1 text
  encoded.begin_array({2}).dtype("u1", "|").boolean(false);
  encoded.global("_codecs", "encode").mark().text("\xc3\xbf\x01").text("latin1").tuple().reduce().end_array();
  EXPECT_EQ(run(encoded.stop()).root().array->as<std::int32_t>(), (std::vector<std::int32_t>{255, 1}));

  PickleBuilder scalar;
  scalar.global("numpy._core.multiarray", "scalar").mark().dtype("f4").data(little(0x40200000, 4)).tuple().reduce();
  EXPECT_EQ(run(scalar.stop()).root().real, 2.5);

  PickleBuilder buffer(5);
  buffer.global("numpy.core.numeric", "_frombuffer").mark().op("\x96" + little(4, 8) + little(7, 4)).dtype("i4");
  buffer.mark().integer(1).tuple().text("C").tuple().reduce();
  EXPECT_EQ(run(buffer.stop()).root().array->as<std::int32_t>(), std::vector<std::int32_t>{7});
}

TEST(Pickle, RefusesEverythingElseByName) {
  EXPECT_NE(problem("cos\nsystem\n(S'true'\ntR.").find("not supported: pickled 'os.system'"), std::string::npos);
  EXPECT_NE(problem("cos\nsystem\n.").find("byte 100"), std::string::npos);
  EXPECT_NE(problem(raw("\x80\x04\x8c\x08"
                        "builtins\x8c\x04"
                        "eval\x93."))
                .find("builtins.eval"),
            std::string::npos);
  EXPECT_NE(problem(raw("\x80\x04\x8c\x08"
                        "builtins\x8c\x04"
                        "eval\x93."))
                .find("byte 118"),
            std::string::npos);
  EXPECT_NE(problem("(ios\nsystem\n.").find("not supported: pickle instruction 105"), std::string::npos);
  EXPECT_NE(problem("ctorch\nFloatStorage\n)R.").find("calling 'FloatStorage'"), std::string::npos);
  EXPECT_NE(problem("](K\x01K\x02tQ.").find("persistent ids"), std::string::npos);
  EXPECT_NE(problem("\x80\x09.").find("protocol 9"), std::string::npos);
  EXPECT_NE(problem("]N"
                    "b.")
                .find("setting the state of a list"),
            std::string::npos);
  PickleBuilder complex;
  complex.dtype("c16");
  EXPECT_NE(problem(complex.stop()).find("'c16'"), std::string::npos);
}

TEST(Pickle, RefusesDamage) {
  for (const char* damaged : {"",
                              "N",
                              "0.",
                              "a.",
                              "t.",
                              "]]",
                              "(.",
                              "NN.",
                              "K",
                              "Xabc",
                              "h\x05.",
                              "(N}u.",
                              "]N}s.",
                              "I1x\n.",
                              "Sabc\n.",
                              "V\\u12\n.",
                              "X\x02\x00\x00\x00\xc0\x80.",
                              "Fabc\n.",
                              "NR.",
                              ")NR."}) {
    EXPECT_NE(problem(damaged), "accepted") << damaged;
  }
  EXPECT_NE(problem(raw("\x80\x04\x8e\xff\xff\xff\xff\xff\xff\xff\xff"
                        "abc."))
                .find("ends early"),
            std::string::npos);
  PickleBuilder wrong_size;
  wrong_size.begin_array({3}).dtype("f4").boolean(false).data("1234").end_array();
  EXPECT_NE(problem(wrong_size.stop()).find("12 bytes"), std::string::npos);
  PickleBuilder huge;
  huge.begin_array({2147483647, 2147483647, 2147483647}).dtype("f8").boolean(false).data("").end_array();
  EXPECT_NE(problem(huge.stop()).find("overflows"), std::string::npos);
}

TEST(Pickle, MemoryIsBoundedByTheFile) {
  // 200 bytes of instructions that turn one megabyte into two hundred arrays.
  PickleBuilder bomb;
  bomb.data(std::string(1 << 20, 'x')).op("q\x01").dtype("u1").op("q\x02").mark();
  for (int i = 0; i < 200; ++i) {
    bomb.global("numpy.core.numeric", "_frombuffer")
        .mark()
        .op("h\x01h\x02")
        .mark()
        .integer(1 << 20)
        .tuple()
        .text("C")
        .tuple()
        .reduce();
  }
  EXPECT_NE(problem(bomb.tuple().stop()).find("larger than the pickle"), std::string::npos);
}

}  // namespace
}  // namespace anigen::io::pickle
