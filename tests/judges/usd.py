"""Prints what the library of USD's makers reads in a file, and everything its validators say of it, as JSON.

Usage: python usd.py FILE.usdz"""

import json
import sys

from pxr import Usd, UsdGeom, UsdShade, UsdValidation

stage = Usd.Stage.Open(sys.argv[1])
mesh = UsdGeom.Mesh(stage.GetDefaultPrim().GetChild("triangles"))
primvars = UsdGeom.PrimvarsAPI(mesh)


def corners(name):
    """The values of a primvar, and what each is of."""
    primvar = primvars.GetPrimvar(name)
    if not primvar:
        return None
    return {"of": primvar.GetInterpolation(), "values": [list(value) for value in primvar.Get()]}


validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
errors = UsdValidation.ValidationContext(validators).Validate(stage)
surface = UsdShade.Material(stage.GetPrimAtPath("/scene/material")).ComputeSurfaceSource()[0]
print(json.dumps({
    "up": UsdGeom.GetStageUpAxis(stage),
    "metres": UsdGeom.GetStageMetersPerUnit(stage),
    "points": [list(point) for point in mesh.GetPointsAttr().Get()],
    "indices": list(mesh.GetFaceVertexIndicesAttr().Get()),
    "triangles": len(mesh.GetFaceVertexCountsAttr().Get()),
    "colors": corners("displayColor"),
    "places": corners("st"),
    "surface": surface.GetIdAttr().Get(),
    "validators": len(validators),
    "errors": [f"{error.GetName()}: {error.GetMessage()}" for error in errors],
}))
