#pragma once
#include "anigen/core/json.h"
#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io {

/// What a pickle says in plain values: None, booleans, numbers and texts, lists and tuples of them, dicts of them by
/// text or integer. Everything else becomes null, an entry of a dict by another kind of key is left out.
/// @throws InputError for cycles and for sharing that explodes
Json plain_json(const pickle::Value& value, const NpyPlace& place);

}  // namespace anigen::io
