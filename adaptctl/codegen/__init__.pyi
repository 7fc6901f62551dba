from adaptctl.codegen.exporting import Exported as Exported
from adaptctl.codegen.exporting import export as export
