from semap_ingest.pipeline.identity import fingerprint


def test_what_changes_the_results_changes_the_identity(tmp_path):
    folder, model = tmp_path / "bag", tmp_path / "model.onnx"
    folder.mkdir()
    (folder / "a.db3").write_bytes(b"1")
    (folder / "metadata.yaml").write_bytes(b"2")
    model.write_bytes(b"3")

    def identity(options=("map", 0.0), model=model):
        return fingerprint(folder, [] if model is None else [model], options)

    first = identity()
    assert identity() == first
    changed = {identity(options=("odom", 0.0)), identity(model=None)}
    (folder / "a.db3").write_bytes(b"11")
    changed.add(identity())
    model.write_bytes(b"33")
    changed.add(identity())
    assert len(changed | {first}) == 5


def test_names_and_what_a_reader_leaves_behind_change_nothing(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        folder.mkdir()
        (folder / f"{folder.name}.db3").write_bytes(b"1")
    (other / "other.db3-shm").write_bytes(b"2")
    assert fingerprint(one, [], ()) == fingerprint(other, [], ())
