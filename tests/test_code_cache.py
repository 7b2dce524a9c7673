"""The cache of machine code: what it never deletes, never loads, and works without."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tsmblocks.engine import code_cache, jit

POSIX_ONLY = pytest.mark.skipif(sys.platform == "win32", reason="folders of a user, links and forks of POSIX")
TEXT = "define void @run(ptr %t) {\n  ret void\n}\n"
RUN = "import tsmblocks as tsm\ntsm.simulate(tsm.load('tendon_sheath_linear'), stop=0.01, inputs={'x_in': 1.0})\n"
REPOSITORY = Path(__file__).parents[1]


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of this test alone, with nothing loaded."""
    monkeypatch.setenv("TSMBLOCKS_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(jit, "_LOADED", {})
    return tmp_path / "cache"


def compiled(text=TEXT):
    jit._LOADED.clear()
    jit.compile_text(text, promote=True)


def entries(cache):
    return sorted(cache.rglob("*.o"))


def numbered(k):
    return f"define void @run(ptr %t) {{\n  store i64 {k}, ptr %t\n  ret void\n}}\n"


# ---- what is deleted


@POSIX_ONLY
@pytest.mark.parametrize("linked", [False, True])
def test_files_of_others_in_the_named_folder_are_never_deleted(linked, cache, tmp_path, monkeypatch):
    folder = tmp_path / "thesis"
    folder.mkdir(mode=0o700)
    if linked:
        cache.symlink_to(folder)
    else:
        monkeypatch.setenv("TSMBLOCKS_CACHE", str(folder))
    mine = [folder / "results.csv", folder / f"{'a' * 64}.o"]
    for path in mine:
        path.write_text("years of work", encoding="utf-8")
        os.utime(path, (0, 0))  # older than any machine code
    monkeypatch.setattr(code_cache, "CACHE_BYTES", 1)
    monkeypatch.setattr(code_cache, "WRITES_PER_PRUNE", 1)
    for k in range(3):
        compiled(numbered(k))
    assert [path.read_text(encoding="utf-8") for path in mine] == ["years of work"] * 2


def test_of_the_own_folder_only_what_bears_name_and_mark_of_the_cache_is_deleted(cache, monkeypatch):
    compiled()
    folder = entries(cache)[0].parent
    kept = [folder / "notes.txt", folder / f"{'a' * 64}.o", folder / f".{'b' * 64}.o-1234.new"]
    for path in kept:
        path.write_text("mine", encoding="utf-8")
        os.utime(path, (0, 0))
    (folder / f"{'c' * 64}.o").mkdir()
    for name in (f".{'d' * 64}.o-1234.new", f".{'d' * 40}.{'0' * 16}.new"):  # of an earlier version, and of this one
        abandoned = folder / name
        for content in (b"", b"tsmblocks machine code 2\npart"):
            abandoned.write_bytes(content)
            os.utime(abandoned, (0, 0))
            code_cache.prune(folder)
            assert not abandoned.exists()
    monkeypatch.setattr(code_cache, "CACHE_BYTES", 1)
    code_cache.prune(folder)
    assert entries(cache) == sorted([kept[1], folder / f"{'c' * 64}.o"])
    assert all(path.exists() for path in kept)


def test_what_a_killed_process_left_unfinished_is_deleted_later(cache, monkeypatch):
    """Its name is one that the cache knows: a process that ends in the middle of an entry leaves no file for ever."""
    made = []
    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", lambda *_: pytest.fail("not used"))
        patched.setattr(Path, "replace", lambda path, _target: made.append((path, path.read_bytes())))
        compiled()
    for path, content in made:
        if path.parent.name == code_cache.FOLDER and not path.name.startswith("."):
            continue
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
        os.utime(path, (0, 0))
    compiled()
    folder = entries(cache)[0].parent
    code_cache.prune(folder)
    assert [path.name for path in folder.glob(".*.new") if "CACHEDIR" not in path.name] == []


@POSIX_ONLY
def test_a_link_in_place_of_an_entry_is_replaced_and_not_followed(cache, tmp_path):
    compiled()
    (entry,) = entries(cache)
    victim = tmp_path / "victim"
    victim.write_text("mine", encoding="utf-8")
    entry.unlink()
    entry.symlink_to(victim)
    compiled()
    assert victim.read_text(encoding="utf-8") == "mine"
    assert not entry.is_symlink()
    assert entry.stat().st_mode & 0o077 == 0


def test_a_folder_of_that_name_which_the_cache_did_not_make_is_not_used(cache):
    folder = cache / code_cache.FOLDER
    folder.mkdir(parents=True, mode=0o700)
    (folder / "thesis.txt").write_text("mine", encoding="utf-8")
    compiled()
    assert [path.name for path in folder.iterdir()] == ["thesis.txt"]


def test_the_oldest_entries_go_first(cache, monkeypatch):
    for k in range(4):
        compiled(numbered(k))
    found = entries(cache)
    for age, path in enumerate(found):
        os.utime(path, (1000 - age, 1000 - age))
    monkeypatch.setattr(code_cache, "CACHE_BYTES", sum(path.stat().st_size for path in found[:2]))
    code_cache.prune(found[0].parent)
    assert entries(cache) == found[:2]


# ---- what is loaded


def planted(body):
    """The form of entries that needs no key: a digest that anybody can make."""
    return [
        magic + hashlib.sha256(body).digest() + body
        for magic in (b"tsmblocks machine code 1\n", b"tsmblocks machine code 2\n")
    ]


@pytest.mark.parametrize("body", [b"", b"junk" * 100])
def test_junk_with_a_digest_that_anybody_can_make_is_compiled_anew(body, cache):
    compiled()
    (path,) = entries(cache)
    good = path.read_bytes()
    for content in planted(body):
        path.write_bytes(content)
        compiled()
        assert path.read_bytes() == good


def test_an_entry_under_the_name_of_another_is_compiled_anew(cache):
    compiled(numbered(1))
    (first,) = entries(cache)
    wrong = first.read_bytes()
    compiled(numbered(2))
    (second,) = set(entries(cache)) - {first}
    good = second.read_bytes()
    second.write_bytes(wrong)
    compiled(numbered(2))
    assert second.read_bytes() == good


def test_code_of_another_user_is_compiled_anew(cache, tmp_path, monkeypatch):
    compiled()
    (path,) = entries(cache)
    before = path.read_bytes()
    monkeypatch.setattr(code_cache, "user_directory", lambda: tmp_path / "other user")
    compiled()
    assert path.read_bytes() != before
    assert len((tmp_path / "other user" / "key").read_bytes()) == code_cache.KEY_BYTES


@POSIX_ONLY
def test_the_key_is_for_the_user_alone_and_a_damaged_one_is_replaced(cache, tmp_path, monkeypatch):
    user = tmp_path / "user"
    monkeypatch.setattr(code_cache, "user_directory", lambda: user)
    compiled()
    assert (user / "key").stat().st_mode & 0o077 == 0
    for damage in (b"", b"short"):
        (user / "key").write_bytes(damage)
        compiled()
        assert len((user / "key").read_bytes()) == code_cache.KEY_BYTES
        assert code_cache.read_code(entries(cache)[0].stem) is not None


# ---- where it is kept, and runs without it


@POSIX_ONLY
@pytest.mark.parametrize("places", [{"XDG_CACHE_HOME": ""}, {"XDG_CACHE_HOME": "here"}, {"TSMBLOCKS_CACHE": "here"}])
def test_nothing_is_read_or_written_in_the_current_folder(places, tmp_path):
    home, work = tmp_path / "home", tmp_path / "cloned"
    home.mkdir()
    work.mkdir()
    env = {k: v for k, v in os.environ.items() if k not in ("XDG_CACHE_HOME", "TSMBLOCKS_CACHE")}
    env |= {"HOME": str(home), "PYTHONPATH": str(REPOSITORY)} | places
    subprocess.run([sys.executable, "-c", RUN], cwd=work, env=env, check=True, timeout=120)
    assert not list(work.iterdir())
    assert entries(home / ".cache" / "tsmblocks")


@POSIX_ONLY
@pytest.mark.parametrize("home", [None, "", "here"])
def test_without_a_home_a_run_needs_no_cache(home, tmp_path):
    """Neither HOME nor an entry of the user, as in a container that runs under any number."""
    env = {k: v for k, v in os.environ.items() if k not in ("HOME", "XDG_CACHE_HOME", "TSMBLOCKS_CACHE")}
    env |= {"PYTHONPATH": str(REPOSITORY)} | ({} if home is None else {"HOME": home})
    code = f"import pwd\ndef nobody(uid): raise KeyError(uid)\npwd.getpwuid = nobody\n{RUN}"
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=env, check=True, timeout=120)
    assert not list(tmp_path.iterdir())


@POSIX_ONLY
@pytest.mark.parametrize("path", ["/proc/none", "/dev/null/cache", "/" + "n" * 5000])
def test_a_folder_that_cannot_be_made_is_done_without(path, monkeypatch):
    monkeypatch.setenv("TSMBLOCKS_CACHE", path)
    compiled()
    assert code_cache.read_code("a" * 64) is None


# ---- forks

FORK = f"""
import os, sys, threading, time, warnings
sys.path.insert(0, {str(REPOSITORY)!r})
warnings.simplefilter("ignore")
from tsmblocks.engine import jit
forked = threading.Event()
def compile_on():  # one text after the other, so that a compilation runs at the fork however fast the machine is
    n = 1000
    while not forked.is_set():
        lines = "".join(f"  %x{{k}} = load volatile i64, ptr %t\\n" for k in range(n))
        jit.compile_text("define void @run(ptr %t) {{\\n" + lines + "  ret void\\n}}\\n", promote=True)
        n += 1
jit.host()  # a thread that is importing when its process forks leaves the import locked in the child
thread = threading.Thread(target=compile_on)
thread.start()
time.sleep(0.1)
assert thread.is_alive()
child = os.fork()
forked.set()
if not child:
    jit.compile_text({TEXT!r}, promote=True)
    os._exit(0)
until = time.monotonic() + 30
while time.monotonic() < until:
    found, status = os.waitpid(child, os.WNOHANG)
    if found:
        break
    time.sleep(0.01)
else:
    os.kill(child, 9)
    os.waitpid(child, 0)
    status = "it hung"
thread.join()
print(status)
"""


@POSIX_ONLY
def test_a_fork_while_a_thread_compiles_leaves_a_child_that_can_compile():
    env = os.environ | {"TSMBLOCKS_CACHE": "off"}
    done = subprocess.run([sys.executable, "-c", FORK], env=env, capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("0\n", "")
