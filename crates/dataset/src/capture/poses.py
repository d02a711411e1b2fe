# Finds poses with pycolmap, step by step, as `trisplat capture` asks for them in JSON.
import json
import os
import sys
import threading
import time

import pycolmap


def given(options, **values):
    """Sets what these options have; names differ from version to version."""
    for name, value in values.items():
        if hasattr(options, name):
            setattr(options, name, value)
    return options


def features(job):
    reader = pycolmap.ImageReaderOptions(camera_model="SIMPLE_RADIAL", camera_params=job["params"])
    mode = pycolmap.CameraMode.PER_FOLDER if job["folders"] else pycolmap.CameraMode.SINGLE
    how = dict(camera_mode=mode, reader_options=reader)
    sizes = dict(max_image_size=job["max_size"], num_threads=job["threads"])
    if hasattr(pycolmap, "FeatureExtractionOptions"):
        how["extraction_options"] = given(pycolmap.FeatureExtractionOptions(), **sizes)
    else:
        how["sift_options"] = given(pycolmap.SiftExtractionOptions(), **sizes)
    pycolmap.extract_features(job["database"], job["images"], **how)


def matches(job):
    how = {}
    if hasattr(pycolmap, "FeatureMatchingOptions"):
        how["matching_options"] = given(pycolmap.FeatureMatchingOptions(), num_threads=job["threads"])
    if job["tree"]:
        pairing = given(pycolmap.VocabTreePairingOptions(), vocab_tree_path=job["tree"])
        pycolmap.match_vocabtree(job["database"], pairing_options=pairing, **how)
    elif job["pairs"]:
        pairing = given(pycolmap.ImportedPairingOptions(), match_list_path=job["pairs"])
        pycolmap.match_image_pairs(job["database"], pairing_options=pairing, **how)
    else:
        pycolmap.match_exhaustive(job["database"], **how)


def model(job):
    run = pycolmap.global_mapping if job["global"] else pycolmap.incremental_mapping
    options = pycolmap.GlobalPipelineOptions() if job["global"] else pycolmap.IncrementalPipelineOptions()
    given(options, random_seed=0, num_threads=job["threads"])
    if job["straight"]:
        given(options, ba_refine_extra_params=False)
    if hasattr(options, "mapper"):
        given(options.mapper, random_seed=0)
    run(job["database"], job["images"], job["output"], options=options)


def probe(_):
    print("pycolmap", pycolmap.__version__, "global" if hasattr(pycolmap, "global_mapping") else "")


def end_with(parent):
    """Nobody wants what this program does when the one that has started it is gone."""
    while os.getppid() == parent:
        time.sleep(0.2)
    os._exit(1)


if hasattr(os, "getppid"):
    threading.Thread(target=end_with, args=[os.getppid()], daemon=True).start()
job = json.loads(sys.argv[1])
{"probe": probe, "features": features, "matches": matches, "model": model}[job["step"]](job)
