from adaptctl.identification.drives_file import Drives as Drives
from adaptctl.identification.drives_file import read_drives as read_drives
from adaptctl.identification.identification import Identification as Identification
from adaptctl.identification.identified_payload import IdentifiedPayload as IdentifiedPayload
from adaptctl.identification.identify import identify as identify
from adaptctl.identification.validation import Validation as Validation
