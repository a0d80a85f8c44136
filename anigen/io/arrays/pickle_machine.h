#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "anigen/io/arrays/pickle.h"
#include "anigen/io/arrays/pickle_constructors.h"
#include "anigen/io/arrays/pickle_scanner.h"

namespace anigen::io::pickle {

/// The stack machine itself. Loops over instructions; nothing recurses.
class Machine {
 public:
  Machine(std::string bytes, Source source);
  /// Reads piece by piece. @param source with `outline`
  Machine(const ByteSource& bytes, Source source);
  virtual ~Machine() = default;
  Machine(const Machine&) = delete;
  Machine& operator=(const Machine&) = delete;

  /// The whole pickle.
  Document run();
  /// A stretch of a pickle that makes one object and has no end of its own.
  /// @param memo_entries that were there before it: objects without a number of their own are counted on from there
  Document run_stretch(std::size_t memo_entries);

 protected:
  /// Called before each instruction, which Scanner::instruction() points at.
  virtual void before(unsigned char) {}
  /// Called after an entry was made in the memo.
  virtual void remembered(std::uint64_t) {}
  /// The value of a memo entry that this machine has not made. Null: there is none.
  virtual Value* remembered_elsewhere(std::uint64_t) { return nullptr; }

  Source source_;
  Document document_;
  Scanner scanner_;
  Constructors constructors_;
  std::vector<Value*> stack_;
  std::vector<std::size_t> marks_;
  std::unordered_map<std::uint64_t, Value*> memo_;
  std::size_t memo_entries_ = 0;  ///< ever made: numbers those that have none

 private:
  void make_constants();
  Document finish();

  void push(Value* value) { stack_.push_back(value); }
  std::size_t bottom() const { return marks_.empty() ? 0 : marks_.back(); }
  Value* pop();
  Value* top();
  std::vector<Value*> pop_to_mark();
  Value* pop(Kind kind);

  std::string_view lasting(std::string_view text);
  void push_int(std::int64_t integer);
  void push_float(double real);
  void push_text(Kind kind, std::string_view text);
  void push_bytes(std::uint64_t count);
  void push_items(Kind kind, std::vector<Value*> items);
  void push_tuple(std::size_t count);
  void push_long(std::string_view little_endian);
  void push_decimal(std::string_view line);
  void extend(Kind kind, const std::vector<Value*>& items, std::size_t group);
  void remember(std::uint64_t key);
  void recall(std::uint64_t key);
  std::uint64_t memo_key(std::string_view line);
  void call();

  bool step(unsigned char instruction);
  bool step_text(unsigned char instruction);
  bool step_container(unsigned char instruction);
  bool step_object(unsigned char instruction);

  Value* none_ = nullptr;
  Value* booleans_[2] = {nullptr, nullptr};
};

}  // namespace anigen::io::pickle
