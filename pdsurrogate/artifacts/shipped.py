"""Digests of the cards of artifacts that were shipped before cards contained a digest, by the
hash of ``surrogate.npz``.
"""

SHIPPED_CARDS = {
    # arruda-boyce-isochoric@1
    "141e85664064c9338100b50c2700d52f6a12435cde45fc0172360f0e77bd75c8": (
        "f8a39c831ee924eb34890415c2993b7c33c38222ee3dd750ca45db27045dbd3e"
    ),
    # full-network@1
    "f47afb9a2c72d2628a085b1eb6b0e7ba8137b06b07808383a3b19d70b4f6bb0f": (
        "3c3c48c59839431f2d8f0f321ef44faacb0a6ce69d02ed029942e501a1b73469"
    ),
    # full-network-isochoric@1
    "986f2f059b316d4158befc4198673ed982e19c28767c7212a1c39b0d0f8cb8db": (
        "ea962a9ac8f60c8cec4ac6b1813fdd46ab086463e3916e68b4e697bf91d81780"
    ),
    # gent@1
    "2ffa2a632ad046333e19509f07ab7c5e479f5563d93cdd2a8a15b5909128c4cf": (
        "3be3a3b146fc8cf92f872f2b0e183c3e16af9ddeec53887bad54c932a245fd5b"
    ),
    # neo-hookean@1
    "87d0d4afe240dac1c09bee51fa9bef1bde09d2923719ecf0980bac5dc2acdc66": (
        "4e92baf1a6c23bb4428fda61a400a892c21cc82da06d84b796068b5d9e67106e"
    ),
    # neo-hookean@2
    "391a8513703a7fe9cbb487acf3ffdcddec88ba48c584037b62c356a8da999ff8": (
        "d2ba212cc2787b07813a953ea4011c65f7ea4e5fc07260590b0d8be9ce955398"
    ),
    # neo-hookean-energy@1
    "e39ebe0e3706a067b1ca68e985242ce909f33163d31eb77e081d8f5e029fcf8e": (
        "216d833f30bab97e2c0e7c167bb65ea93a45cbee82af586136c929b4c9da3a35"
    ),
    # neo-hookean-isochoric@1
    "f15f10dd7de5ddb5b04e2b1623153687943d1f61d609cd1485b5f840a928e50a": (
        "77bf958811ce7e50a8d5b390f2165c6866867a00feeda770973c59800985c4a1"
    ),
    # neo-hookean-paper@1
    "4fba5c1c07a1669e672f75a5418193901367b6e884c6dac57955d1da1ad7fc26": (
        "371d11a5fb9c7395f6c5f4b0b6efdc2325b955f79aaeaf0e9d1ed126049b19de"
    ),
    # ogden@1
    "779bf910fc8f5a4f0e59990559489ebe3ab72298ddf0bc78b5cf34e540a60ffd": (
        "7db587567cb601d5b9ac166f829cd111561f7605a038116223e220d814617d8d"
    ),
    # ogden-isochoric@1
    "e667f1fcdca7c91fc1cbccd842d780922cfa94beca8bdbd5bf93e7589fff4c3d": (
        "907a247a3317db68cb224a94f4c673f35ce65d9166459c9864be8dcaeab54d35"
    ),
}
"""Digest of a card (`Card.found_digest`) by the SHA-256 of its ``surrogate.npz``."""
