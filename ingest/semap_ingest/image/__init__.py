"""From a camera's image to boxes: decoding, and detectors that are ONNX files of any usual kind.

    Image ──input_form──> tensor ──model_file──> outputs ──layout──> candidates ──suppression──> Boxes

`recognition` tells from a model's outputs which `layout` they have; `arrangement` says what each would look
like, and the decoders (`dense`, `heads`, `queries`, `suppressed`) make candidates of them.
"""
