#include "anigen/io/arrays/pickle_outline.h"

#include <algorithm>
#include <utility>

#include "anigen/io/arrays/pickle_machine.h"

namespace anigen::io::pickle {

namespace {

constexpr std::size_t kLongestKept = 64;  // bytes of a text that others may refer back to

/// Thrown where dictionaries cannot be read apart.
struct Entangled {};

/// Instructions that take the object on top of the stack for an item of something else, or begin the next item.
bool ends_item(unsigned char instruction) {
  static constexpr std::string_view kEnds = "}aetl.0\x85\x86\x87";
  return kEnds.find(static_cast<char>(instruction)) != std::string_view::npos;
}

void copy_leaf(const Value& from, Value& to) {
  to.kind = from.kind;
  to.global = from.global;
  to.integer = from.integer;
  to.text = from.text;
  to.element = from.element;
}

}  // namespace

/// The value's copy in this outline; equal texts are one. Null for what is not kept.
Value* Outline::kept(const Value& value) {
  const bool text = value.kind == Kind::kString || value.kind == Kind::kBytes;
  const bool named = value.kind == Kind::kGlobal || value.kind == Kind::kDtype || value.kind == Kind::kOpaque;
  if (!named && !(text && value.text.size() <= kLongestKept)) return nullptr;
  auto& known = value.kind == Kind::kString ? strings_ : byte_strings_;
  if (text) {
    const auto there = known.find(value.text);
    if (there != known.end()) return there->second;
  }
  leaves_.emplace_back();
  Value& leaf = leaves_.back();
  copy_leaf(value, leaf);
  texts_.emplace_back(value.text);
  leaf.text = texts_.back();
  if (text) known.emplace(leaf.text, &leaf);
  return &leaf;
}

/// Runs a pickle and forgets each outermost dictionary when it is complete.
class OutlineMachine : public Machine {
 public:
  OutlineMachine(const ByteSource& bytes, Source source, std::string_view name_key)
      : Machine(bytes, std::move(source)), name_key_(name_key), placeholder_(constructors_.make(Kind::kOpaque)) {}

  /// False when what it holds is no list of the dictionaries found.
  bool outline(Outline& found) {
    found_ = &found;
    const Document document = run();
    scanner_.skip(scanner_.size() - scanner_.position());  // whatever follows belongs to the checksum
    const Value& root = document.root();
    if (root.kind != Kind::kObjectArray || found.dicts_.empty()) return false;
    const bool in_list = root.items.size() == 1 && root.items[0]->kind == Kind::kList;
    const std::vector<Value*>& items = in_list ? root.items[0]->items : root.items;
    const auto is_dict = [this](const Value* item) { return item == placeholder_; };
    if (items.size() != found.dicts_.size() || !std::all_of(items.begin(), items.end(), is_dict)) return false;
    keep_leaves();
    found.sizes_ = root.sizes;
    found.memo_ = std::move(memo_);
    return true;
  }

 protected:
  void before(unsigned char instruction) override {
    if (begins_) {
      dict_ = stack_.back();
      begins_ = false;
    }
    if (dict_ != nullptr) {
      if (stack_.size() <= height_) throw Entangled();
      const bool on_top = stack_.size() == height_ + 1 && marks_.size() == marks_below_;
      if (on_top && ends_item(instruction)) complete();
    }
    if (dict_ == nullptr && instruction == '}') {
      keep_leaves();
      begins_ = true;
      height_ = stack_.size();
      marks_below_ = marks_.size();
      extent_ = document_.extent();
      next_ = {scanner_.instruction(), 0, memo_entries_, {}};
    }
  }

  void remembered(std::uint64_t key) override { keys_.push_back(key); }

  /// An entry that was forgotten, or never was: reading the whole tells.
  Value* remembered_elsewhere(std::uint64_t) override { throw Entangled(); }

 private:
  void complete() {
    next_.bytes = scanner_.instruction() - next_.first;
    for (std::size_t i = 0; i + 1 < dict_->items.size(); i += 2) {
      const Value& key = *dict_->items[i];
      const Value& value = *dict_->items[i + 1];
      if (key.kind == Kind::kString && key.text == name_key_ && value.kind == Kind::kString)
        next_.name = std::string(value.text);
    }
    found_->dicts_.push_back(std::move(next_));
    keep_leaves();
    stack_.back() = placeholder_;
    document_.forget(extent_);
    dict_ = nullptr;
  }

  /// Of the memo's entries since the last call, what later parts may refer to.
  void keep_leaves() {
    for (const std::uint64_t key : keys_) {
      const auto entry = memo_.find(key);
      if (entry == memo_.end()) continue;
      entry->second = found_->kept(*entry->second);
      if (entry->second == nullptr) memo_.erase(entry);
    }
    keys_.clear();
  }

  std::string_view name_key_;
  Value* placeholder_;
  Outline* found_ = nullptr;
  std::vector<std::uint64_t> keys_;  ///< of entries in the memo since keep_leaves()
  // The outermost dictionary that is being made, and the machine's state before it.
  bool begins_ = false;
  Value* dict_ = nullptr;
  std::size_t height_ = 0, marks_below_ = 0;
  std::pair<std::size_t, std::size_t> extent_;
  Outline::Dict next_;
};

/// Runs one dictionary's stretch with what the parts before it left in the memo.
class StretchMachine : public Machine {
 public:
  StretchMachine(std::string bytes, Source source, const Outline& outline)
      : Machine(std::move(bytes), std::move(source)), outline_(outline) {}

 protected:
  Value* remembered_elsewhere(std::uint64_t key) override {
    const auto found = outline_.memo_.find(key);
    if (found == outline_.memo_.end()) return nullptr;
    Value* leaf = constructors_.make(found->second->kind);
    copy_leaf(*found->second, *leaf);
    return memo_[key] = leaf;
  }

 private:
  const Outline& outline_;
};

std::unique_ptr<const Outline> Outline::read(const ByteSource& bytes, const Source& source, std::string_view name_key) {
  Source outlined = source;
  outlined.outline = true;
  auto outline = std::make_unique<Outline>();
  try {
    if (!OutlineMachine(bytes, std::move(outlined), name_key).outline(*outline)) return nullptr;
  } catch (const Entangled&) {
    return nullptr;
  }
  return outline;
}

Document Outline::load(const ByteSource& bytes, const Source& source, std::size_t index) const {
  const Dict& dict = dicts_.at(index);
  std::string stretch(dict.bytes, '\0');
  bytes.read(dict.first, stretch.data(), stretch.size());
  Source from = source;
  from.first_byte += dict.first;
  return StretchMachine(std::move(stretch), std::move(from), *this).run_stretch(dict.memo_entries);
}

}  // namespace anigen::io::pickle
