#pragma once
/// Images of assets by ray tracing (Embree): views of datasets with their cameras, contact sheets, visibility.
#include "anigen/render/cameras_json.h"
#include "anigen/render/caption.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/dataset_views.h"
#include "anigen/render/picture.h"
#include "anigen/render/scene.h"
#include "anigen/render/shading.h"
#include "anigen/render/surface_color.h"
#include "anigen/render/visibility.h"
