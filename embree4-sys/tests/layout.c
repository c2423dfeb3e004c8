/* The layout of Embree's structs as this machine's C compiler sees it, and what the headers' inline functions write, for
 * layout.rs to compare with what Rust has. Keep its table and this one alike. */
#include <embree4/rtcore.h>
#include <stdalign.h>
#include <stddef.h>

struct Entry {
  const char* type;
  const char* field; /* null for the struct as a whole */
  size_t size;
  size_t offset_or_alignment;
};

#define WHOLE(type) {#type, NULL, sizeof(struct type), alignof(struct type)}
#define FIELD(type, field) {#type, #field, sizeof(((struct type*)0)->field), offsetof(struct type, field)}

static const struct Entry entries[] = {
  WHOLE(RTCRay),
  FIELD(RTCRay, org_x),
  FIELD(RTCRay, org_y),
  FIELD(RTCRay, org_z),
  FIELD(RTCRay, tnear),
  FIELD(RTCRay, dir_x),
  FIELD(RTCRay, dir_y),
  FIELD(RTCRay, dir_z),
  FIELD(RTCRay, time),
  FIELD(RTCRay, tfar),
  FIELD(RTCRay, mask),
  FIELD(RTCRay, id),
  FIELD(RTCRay, flags),

  WHOLE(RTCHit),
  FIELD(RTCHit, Ng_x),
  FIELD(RTCHit, Ng_y),
  FIELD(RTCHit, Ng_z),
  FIELD(RTCHit, u),
  FIELD(RTCHit, v),
  FIELD(RTCHit, primID),
  FIELD(RTCHit, geomID),
  FIELD(RTCHit, instID),
  FIELD(RTCHit, instPrimID),

  WHOLE(RTCRayHit),
  FIELD(RTCRayHit, ray),
  FIELD(RTCRayHit, hit),

  WHOLE(RTCRayQueryContext),
  FIELD(RTCRayQueryContext, instID),
  FIELD(RTCRayQueryContext, instPrimID),

  WHOLE(RTCIntersectArguments),
  FIELD(RTCIntersectArguments, flags),
  FIELD(RTCIntersectArguments, feature_mask),
  FIELD(RTCIntersectArguments, context),
  FIELD(RTCIntersectArguments, filter),
  FIELD(RTCIntersectArguments, intersect),

  WHOLE(RTCOccludedArguments),
  FIELD(RTCOccludedArguments, flags),
  FIELD(RTCOccludedArguments, feature_mask),
  FIELD(RTCOccludedArguments, context),
  FIELD(RTCOccludedArguments, filter),
  FIELD(RTCOccludedArguments, occluded),

  WHOLE(RTCBounds),
  FIELD(RTCBounds, lower_x),
  FIELD(RTCBounds, lower_y),
  FIELD(RTCBounds, lower_z),
  FIELD(RTCBounds, align0),
  FIELD(RTCBounds, upper_x),
  FIELD(RTCBounds, upper_y),
  FIELD(RTCBounds, upper_z),
  FIELD(RTCBounds, align1),

  WHOLE(RTCBoundsFunctionArguments),
  FIELD(RTCBoundsFunctionArguments, geometryUserPtr),
  FIELD(RTCBoundsFunctionArguments, primID),
  FIELD(RTCBoundsFunctionArguments, timeStep),
  FIELD(RTCBoundsFunctionArguments, bounds_o),

  WHOLE(RTCIntersectFunctionNArguments),
  FIELD(RTCIntersectFunctionNArguments, valid),
  FIELD(RTCIntersectFunctionNArguments, geometryUserPtr),
  FIELD(RTCIntersectFunctionNArguments, primID),
  FIELD(RTCIntersectFunctionNArguments, context),
  FIELD(RTCIntersectFunctionNArguments, rayhit),
  FIELD(RTCIntersectFunctionNArguments, N),
  FIELD(RTCIntersectFunctionNArguments, geomID),

  WHOLE(RTCOccludedFunctionNArguments),
  FIELD(RTCOccludedFunctionNArguments, valid),
  FIELD(RTCOccludedFunctionNArguments, geometryUserPtr),
  FIELD(RTCOccludedFunctionNArguments, primID),
  FIELD(RTCOccludedFunctionNArguments, context),
  FIELD(RTCOccludedFunctionNArguments, ray),
  FIELD(RTCOccludedFunctionNArguments, N),
  FIELD(RTCOccludedFunctionNArguments, geomID),

  WHOLE(RTCFilterFunctionNArguments),
  FIELD(RTCFilterFunctionNArguments, valid),
  FIELD(RTCFilterFunctionNArguments, geometryUserPtr),
  FIELD(RTCFilterFunctionNArguments, context),
  FIELD(RTCFilterFunctionNArguments, ray),
  FIELD(RTCFilterFunctionNArguments, hit),
  FIELD(RTCFilterFunctionNArguments, N),

  WHOLE(RTCPointQuery),
  FIELD(RTCPointQuery, x),
  FIELD(RTCPointQuery, y),
  FIELD(RTCPointQuery, z),
  FIELD(RTCPointQuery, time),
  FIELD(RTCPointQuery, radius),
};

const struct Entry* embree4_sys_layout(size_t* count)
{
  *count = sizeof entries / sizeof entries[0];
  return entries;
}

unsigned embree4_sys_invalid_geometry_id(void) { return RTC_INVALID_GEOMETRY_ID; }
void embree4_sys_init_context(struct RTCRayQueryContext* context) { rtcInitRayQueryContext(context); }
void embree4_sys_init_intersect(struct RTCIntersectArguments* arguments) { rtcInitIntersectArguments(arguments); }
void embree4_sys_init_occluded(struct RTCOccludedArguments* arguments) { rtcInitOccludedArguments(arguments); }
